"""Exceptions of texfold."""


class TexfoldError(Exception):
    """Any fault that texfold reports; its message ends with what to do."""


class BankError(TexfoldError):
    """A bank that images cannot be added to: locked, not writable, or with another image of the name."""


class EncodeError(TexfoldError, ValueError):
    """Images or settings that cannot be encoded, or a limit that is reached."""


class LoadError(TexfoldError, ValueError):
    """A file that is not whole, not intact, or larger than the limits allow."""


class RegionError(TexfoldError, IndexError):
    """An image, level or rectangle that the texture does not have."""
