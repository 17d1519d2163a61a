"""What a training's scores say, by fixed rules."""
# The original's yardsticks: a frame without its objects costs 9.25 for each ball that is missing.
OBJECTS_FOUND, PREDICTED = 1.5, 3.0
PARAMETER_SHARE = 0.1
TRUTH = {"k": 4.0, "l": 6.0, "g": 60.0}
# Beyond what seeds do: ten of the Rust port's own (reports/seeds) scatter by some +-20 % in the losses and by +-0.1 % in
# the parameters.
WORSE, APART = 1.5, 0.01

BREAKS, COSTS, NONE = "breaks", "costs accuracy", "no effect seen"


def parameters(record):
    return {name: record[name] for name in TRUTH if name in record}


def objects_found(record):
    return "diverged" not in record and record["L_rec"] < OBJECTS_FOUND


def physics_learned(record):
    """Judged by k (or g); l alone may be right by the identification where k is not."""
    return objects_found(record) and record["L_pred"] < PREDICTED and all(
        abs(value / TRUTH[name] - 1) < PARAMETER_SHARE for name, value in parameters(record).items() if name != "l")


def verdict(record, faithful):
    """Of a training with a defect, beside the one without."""
    if not physics_learned(faithful):
        return "open: the port without the defect fails too"
    if "diverged" in record:
        return f"{BREAKS}: {record['diverged']}"
    if not objects_found(record):
        return f"{BREAKS}: no objects"
    if not physics_learned(record):
        return f"{BREAKS}: no physics"
    ratios = {name: record[name] / faithful[name] for name in ("L_rec", "L_pred")}
    worse = [name for name, ratio in ratios.items() if ratio > WORSE]
    worse += [name for name, value in parameters(record).items() if abs(value / parameters(faithful)[name] - 1) > APART]
    if worse:
        return f"{COSTS}: {', '.join(worse)}"
    return f"{NONE}: losses at most {max(ratios.values()):.2f} times as large"
