"""The table of defects as Markdown."""
import platform
from datetime import date
from importlib.metadata import version

from .departures import departure
from .switches import descriptions
from .verdicts import APART, BREAKS, COSTS, NONE, OBJECTS_FOUND, PARAMETER_SHARE, PREDICTED, WORSE, verdict

HEADER = """# What the known defects of earlier ports do

Each defect was switched on alone in the PyTorch reference, which was then trained by the fast recipe of 2026-11-21
(`torch_reference/training/recipe.toml`), its last phase longer and at larger rates (`overrides.toml` beside it) so that a
defect has time to show. The losses are those of the 500 test clips, squared error summed over a frame: a blank frame costs 18.5 with two balls and 27.7 with
three, one missing ball 9.25. Truth: k 4, l 6 px; g 60. Departure: the first tensor, in the order of the data flow, that
departs from its golden of the original code, and by how much of its largest element, before any training.

**Each row is one training with one seed.**
"""

SECTIONS = {
    "faithful": ("Springs, with the fast recipe's optimizer (Adam, no clipping)", ""),
    "rmsprop": ("Springs, with the original's optimizer", """
The fast recipe takes Adam without clipping, so it has no place for defects 5 and 6. Here TensorFlow 1's RMSProp with
gradients clipped to +-1, at the rates of the fast recipe, takes Adam's place; the first row has no defect.
"""),
    "3bp": ("Three bodies, which alone have defect 12", "\nClips a step in the last phase: 10, not 25.\n"),
}

NOTES = f"""## How to read it

- *{BREAKS}*: the objects are not found (L_rec {OBJECTS_FOUND} or more) or the physics is not learned (L_pred
  {PREDICTED:.0f} or more, or k or g off by {PARAMETER_SHARE:.0%} or more).
- *{COSTS}*: learned, but a loss is more than {WORSE} times that of the port without the defect, or a parameter more
  than {APART:.0%} away from it. Ten seeds of the Rust port (`reports/seeds`) scatter by some +-20 % in the losses and
  by +-0.1 % in the parameters.
- *{NONE}*: none of these.

The fast recipe is more robust than the original's protocol, so a defect that does no harm here may do some there, where
nothing is guided and 500 epochs are taken from arbitrary initial values:

- 1 scrambles target and input alike: the network sees and draws scrambled frames.
- 3 starts from the wrong frame's position with the velocity refined at the right one. L_pred is scored on the frames
  that the original predicts, whatever the port was trained on.
- 4 keeps the recipe's own start of background, templates and mask logits.
- 10 and the recipe's exact shift correct the same 3 % of length twice.
- 12 keeps g at 1. The objects are found first; the fit then blames their templates, the re-centring moves them by
  pixels, and the last phase has to find them again. Read its L_rec with that in mind; its L_pred does not recover.
"""


def judge(name, baseline, records):
    return verdict(records[name], records[baseline]) if baseline in records else "open: nothing to compare with yet"


def table(names, baseline, records, trainings, goldens):
    symbols = ["g"] if trainings[baseline].task_key == "3bp_color" else ["k", "l"]
    columns = ["", "defect", "departs first", "by", "L_rec", "L_pred", *symbols, "steps", "verdict"]
    lines = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    for name in names:
        record, number = records[name], trainings[name].defect
        what = [str(number), descriptions()[number], *departure(number, goldens)] if number else ["–", "none", "–", "–"]
        figures = [f"{record[figure]:.3f}" if figure in record else "–" for figure in ("L_rec", "L_pred", *symbols)]
        steps = record.get("discover_steps", 0) + record.get("join_steps", 0)
        judged = judge(name, baseline, records) if number else "–"
        lines.append("| " + " | ".join([*what, *figures, str(steps), judged]) + " |")
    return "\n".join(lines)


def statement(judged):
    """Which defects matter, from {number: verdict} alone."""
    judged = {n: judged.get(n, "not trained") for n in descriptions()}
    groups = {BREAKS: "**They matter, each alone breaks learning:**", COSTS: "**They cost accuracy:**",
              NONE: "**No effect seen here, with one seed each:**", "open": "**Open:**", "not trained": "**Not trained yet:**"}
    found = {kind: [str(n) for n, text in sorted(judged.items()) if text.startswith(kind)] for kind in groups}
    return "\n".join(f"- {groups[kind]} {', '.join(numbers)}" for kind, numbers in found.items() if numbers)


def report(records, trainings, goldens, seed, steps):
    """`records` by the names of `trainings`."""
    parts, judged = [HEADER], {}
    for baseline, (title, text) in SECTIONS.items():
        alike = [name for name, each in trainings.items() if name in records and
                 (each.task_key, each.rmsprop) == (trainings[baseline].task_key, trainings[baseline].rmsprop)]
        names = sorted(alike, key=lambda name: trainings[name].defect)
        judged |= {trainings[name].defect: judge(name, baseline, records) for name in names if name != baseline}
        if names:
            parts.append(f"## {title}\n{text}\n{table(names, baseline, records, trainings, goldens)}\n")
    minutes = sum(record["seconds"] for record in records.values()) / 60
    made = (f"`make compare-defects`, {date.today()}, seed {seed}, at most {steps} gradient steps for each training,\n"
            f"float32, one thread, {platform.machine()}, Python {platform.python_version()}, torch {version('torch')}, "
            f"numpy {version('numpy')}; {minutes:.0f} minutes of training in all.\n")
    parts += [f"## Which matter\n\n{statement(judged)}\n", NOTES, f"## Made with\n\n{made}"]
    return "\n".join(parts)
