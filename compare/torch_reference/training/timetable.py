"""When the rates of a phase fall and when it ends (`schedule`)."""


class Timetable:
    """`ignored`: validations at the start that do not enter the criterion."""

    def __init__(self, schedule, max_steps, ignored=0):
        self.schedule, self.max_steps, self.ignored = schedule, max_steps, ignored
        self.anneal_from = int(schedule["anneal_at"] * max_steps)

    def anneal_start(self, scores):
        """A plateau brings it forward; share 0 switches that off."""
        share, counted = self.schedule["plateau"], scores[self.ignored:]
        place = plateau_at(counted, self.schedule["patience"], share) if share else None
        if place is None:
            return self.anneal_from
        return min(self.anneal_from, (place + self.ignored) * self.schedule["validate_every"])

    def annealed(self, step, scores):
        return step >= self.anneal_start(scores)

    def last_step(self, scores):
        """As many steps are taken at the lower rates as at the end of the whole timetable."""
        return self.anneal_start(scores) + self.max_steps - self.anneal_from


def plateau_at(scores, patience, share):
    """The first score at which the best of the last `patience` is less than `share` below the best before them."""
    for seen in range(patience + 1, len(scores) + 1):
        if min(scores[seen - patience:seen]) > (1 - share) * min(scores[:seen - patience]):
            return seen - 1
    return None
