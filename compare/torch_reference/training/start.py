"""Initial values from which every object is found (the port's `discover`)."""
import torch

from .. import blocks

BUMP_WIDTH, BACKGROUND_KERNEL, LOGIT_MARGIN = 0.3, 0.1, 0.002


@torch.no_grad()
def set_start(fast, start, frames, moves, median):
    net, decoder = fast.net, fast.net.decoder
    if start["median_background"]:
        logits = torch.logit(median.clamp(LOGIT_MARGIN, 1 - LOGIT_MARGIN))
        begin_at(decoder.background_net, logits.movedim(0, 2), BACKGROUND_KERNEL)
    if start["template_bump"]:
        line = torch.linspace(-1, 1, fast.task.side // 2)
        squared = line[:, None] ** 2 + line**2
        bump = start["template_bump"] * (2 * torch.exp(-squared / (2 * BUMP_WIDTH**2)) - 1)
        begin_at(decoder.template_net, bump.repeat(fast.task.objects, 1, 1), 1.0)
    net.encoder.denses[2].weight *= start["localiser_scale"]
    if start["mask_spread"]:
        spread_masks(net.encoder, frames, moves, start["mask_spread"])


def begin_at(variable, values, kernel):
    """Begins a variable from a network at `values`, its kernel scaled."""
    variable.output.weight *= kernel
    variable.output.bias.copy_(values.flatten())


def spread_masks(encoder, frames, moves, spread):
    """Equal means of the objects' logits, that of the background, and a spread between them, on what moves."""
    unet = blocks.unet if encoder.task.deep else blocks.shallow_unet
    logits = unet(encoder.convolutions, frames, encoder.defects.half_pixel, encoder.defects.relu_logits)
    logits = logits.movedim(1, 0).flatten(1)
    weight = moves.flatten() / moves.sum()
    mean = logits @ weight
    centred = logits - mean[:, None]
    between = centred - centred.mean(0)
    scale = spread / torch.sqrt(torch.sum(between**2 * weight) / len(logits))
    last = encoder.convolutions[-1]
    last.weight *= scale
    last.bias.copy_((last.bias - mean) * scale + 1)
