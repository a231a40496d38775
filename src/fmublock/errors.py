"""Errors when building FMUs."""


class BuildError(Exception):
    """An FMU cannot be built. The message says why."""


class LoadError(BuildError):
    """A block could not be loaded: the file, the class in it, or the file's text is wrong."""


class DisclosureError(BuildError):
    """What an FMU should disclose does not fit its block or its flavour."""


class VersionError(BuildError):
    """FMUs for this version of FMI cannot be built, or not with this flavour."""


class CacheError(BuildError):
    """The cache folder that the environment variable names is not writable."""
