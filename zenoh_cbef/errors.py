"""The one error type for a user's mistakes, and the one for Ctrl-C."""


class UserError(Exception):
    """A mistake that the user can correct: one clear sentence that names the remedy.

    The command line prints it without a traceback and exits with status 2.
    """


class Interrupted(BaseException):
    """The user pressed Ctrl-C; in place of KeyboardInterrupt, which libraries for command lines handle themselves."""
