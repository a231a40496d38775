"""What goes wrong when a block becomes an FMU."""


class BuildError(Exception):
    """An FMU cannot be built. The message says why."""


class LoadError(BuildError):
    """There is no such block: the file, the class in it, or the file's text is wrong."""


class CacheError(BuildError):
    """The folder that was named for what can be made again cannot be written to."""
