"""Code that the parts about load share: a bound of memory that does not depend on the load."""

from campaign import frame

MOST_GROWTH = 200_000_000
"""Bytes that a command may need for the whole load beyond what it needs for a small one."""


def scaled(deadline_in: float, each: float, least: int, most: int) -> int:
    """The number of items that the time allows, with `each` seconds for one."""
    return min(most, max(least, round(deadline_in / each)))


def wrong(small: frame.Ended, whole: frame.Ended, code: int = 0) -> str:
    """What did not hold for a command under load, compared with a run under a small load."""
    for ended in (small, whole):
        if ended.code != code or "Traceback" in ended.text:
            return f"exit code {ended.code}: {ended.text[-1000:]}"
    grown = whole.memory - small.memory
    return f"{grown / 1e6:.0f} MB more memory" if grown > MOST_GROWTH else ""


def title(what: str, small: frame.Ended, whole: frame.Ended) -> str:
    """The title of a finding: `what`, with the measured memory."""
    return (
        f"{what}: {whole.memory / 1e6:.0f} MB, {(whole.memory - small.memory) / 1e6:+.0f} MB "
        f"compared with a small load (bound {MOST_GROWTH / 1e6:.0f} MB), {whole.seconds:.0f} s"
    )
