"""Counts in words."""


def counted(count: int, one: str, many: str = "", form: str = "") -> str:
    """A count and what is counted: "1 step", "2 steps"; `many` where more than an s makes the difference.

    Both may go on: `counted(n, "step is late", "steps are late")`. `form` is that of the number.
    """
    return f"{count:{form}} {one if count == 1 else many or f'{one}s'}"
