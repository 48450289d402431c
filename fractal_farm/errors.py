"""The one exception family of the farm.

A message says what is wrong, where, and what to do about it. Exceptions carry exactly one argument, so that they
survive pickling between Ray processes unchanged.
"""

from __future__ import annotations


class FarmError(Exception):
    """Something the farm cannot do; the message names the remedy. The command line exits with 1."""


class InputError(FarmError):
    """Input that somebody wrote is wrong (configuration, genome, path, argument). The command line exits with 2."""


class StorageFullError(FarmError):
    """No space left; nothing was written, and the same put may be tried again once there is."""
