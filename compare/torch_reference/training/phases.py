"""The two phases that descend a loss (`discover`, `join`): loss, score, rates, timetable."""
import torch

from .anchors import claims, find_anchors
from .guides import fade, guides_loss, moving
from .network import latent_error
from .start import set_start
from .timetable import Timetable

MEDIAN_FRAMES, VALIDATION_FRAMES, ANCHOR_FRAMES = 2000, 500, 200


class Discover:
    """The autoencoder alone, on random single frames, guided at first."""
    name = "discover"

    def __init__(self, config, fast, train, valid, seed, max_steps):
        self.config, self.fast, self.train, self.seed = config, fast, train, seed
        self.median = train.random_frames(MEDIAN_FRAMES, seed, "median frame").median(0).values
        frames = train.random_frames(ANCHOR_FRAMES, seed, "anchor frames")
        self.anchors = find_anchors(frames, self.median, self.moving(frames), fast.task.objects, seed)
        self.validation = valid.random_frames(VALIDATION_FRAMES, seed, "validation frames")
        index = torch.arange(fast.task.side)
        self.centres = index + 0.5 if fast.options["exact_shift"] else index * fast.task.side / (fast.task.side - 1)
        # Scores under the guides say nothing about the plain loss.
        guided = config["guide"]["zero_from"] // config["schedule"]["validate_every"]
        self.timetable = Timetable(config["schedule"], max_steps, guided)
        self.rates = [(list(fast.net.encoder.parameters()) + list(fast.net.decoder.parameters()),
                       config["learning_rate"])]

    def moving(self, frames):
        return moving(frames, self.median, self.config["guide"]["temperature"])

    def begin(self):
        frames = self.train.random_frames(self.config["frames"], self.seed, "frames")
        set_start(self.fast, self.config["start"], frames, self.moving(frames), self.median)

    def loss(self, step):
        frames = self.train.random_frames(self.config["frames"], self.seed, "frames", step)
        loss, pos, masks = self.fast.autoencoder_loss(frames)
        weight = fade(self.config["guide"], step)
        if weight:
            claimed = None if self.anchors is None else claims(self.anchors, frames, self.median)
            loss = loss + weight * guides_loss(self.config["guide"], pos, masks, self.moving(frames), claimed,
                                               self.centres)
        return loss

    def score(self):
        score = self.fast.autoencoder_score(self.validation)
        return score, f"L_rec {score:.3f}"


class Join:
    """Encoder, physics and decoder together, with two terms that teach the roll-out and the velocity estimator."""
    name = "join"

    def __init__(self, config, fast, train, valid, seed, max_steps):
        self.config, self.fast, self.train, self.valid, self.seed = config, fast, train, valid, seed
        self.timetable = Timetable(config["schedule"], max_steps)
        physical = list(fast.cell.parameters())
        others = [p for p in fast.net.parameters() if all(p is not q for q in physical)]
        self.rates = [(others, config["learning_rate"]), (physical, config["physics_learning_rate"])]

    def begin(self):
        pass

    def loss(self, step):
        chosen = self.train.shuffled(self.config["batch"], self.seed, step)
        done = self.fast(self.train.batch(chosen, self.fast.training_frames()))
        predicted = done.enc_pos[:, -self.fast.task.pred_steps:]
        return (done.pred_loss + self.fast.task.alpha * done.recons_loss
                + self.config["latent"] * latent_error(done.rolled_out, predicted)
                + self.config["velocity"] * latent_error(done.velocity, done.refined))

    def score(self):
        recons, pred = self.fast.scores(self.valid, self.config["validation_clips"])
        values = " ".join(f"{name} {value:.3f}" for name, value in self.fast.parameters().items())
        return pred + self.fast.task.alpha * recons, f"L_rec {recons:.3f} L_pred {pred:.3f} {values}"
