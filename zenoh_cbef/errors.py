"""The one error type for a user's mistakes."""


class UserError(Exception):
    """A mistake the user can mend: one clear sentence that names the remedy.

    The command line prints it without a traceback and exits with status 2.
    """
