"""Moves each template and its positions together, so that separations are true (`identify`)."""
import torch

RIDGE, LARGEST_TANH = 1e-6, 0.999


@torch.no_grad()
def recentre(fast, frames, offsets):
    """Takes `offsets` [2 N], pixels, off the positions; nothing is drawn differently."""
    encoder, offsets, seen = fast.net.encoder, offsets.float(), {}
    handle = encoder.denses[2].register_forward_hook(lambda layer, inputs, output: seen.update(features=inputs[0]))
    positions = encoder(frames)[0]
    handle.remove()
    solve_output_layer(encoder.denses[2], seen["features"], positions - offsets, fast.task.side / 2)
    shift_sprites(fast, offsets)


def solve_output_layer(layer, features, positions, half):
    """Least squares on the logits, with a ridge around the present weights."""
    objects = positions.shape[1] // 2
    wanted = torch.cat(positions.chunk(objects, 1)) / half - 1
    logits = torch.atanh(wanted.clamp(-LARGEST_TANH, LARGEST_TANH)).double()
    design = torch.cat([features, torch.ones_like(features[:, :1])], 1).double()
    present = torch.cat([layer.weight.T, layer.bias[None]]).double()
    normal = design.T @ design + RIDGE * len(design) * torch.eye(design.shape[1], dtype=torch.float64)
    solved = present + torch.linalg.solve(normal, design.T @ (logits - design @ present))
    layer.weight.copy_(solved[:-1].T)
    layer.bias.copy_(solved[-1])


def shift_sprites(fast, offsets):
    """Shifts each sprite in its window, by a linear map of its network's output layer."""
    decoder, side = fast.net.decoder, fast.task.side
    window = side // 2
    span = (side - 1) / 2 if fast.options["exact_shift"] else window
    columns, rows = (shift_matrices(shift, window) for shift in
                     (offsets.reshape(-1, 2) * decoder.logsigma.exp() * (window - 1.01) / 2 / span).T)
    for variable in (decoder.template_net, decoder.contents_net):
        for values in (variable.output.weight, variable.output.bias):
            sprites = values.reshape(len(rows), window, window, -1)
            values.copy_(torch.einsum("nij,nkl,njlc->nikc", rows, columns, sprites).reshape(values.shape))


def shift_matrices(shifts, size):
    """[objects, size, size]: shift an axis bilinearly, the edge pixels repeated."""
    index = torch.arange(size)
    source = (index - shifts[:, None]).clamp(0, size - 1)
    return torch.relu(1 - (source[..., None] - index).abs())
