"""The one error of the builder: cause, field, remedy."""


class BuildError(Exception):
    """Something in the input cannot become a bundle.

    `cause` says what is wrong, `field` names where (a tensor, a file, an option), `remedy` says what helps.
    """

    def __init__(self, cause: str, *, field: str, remedy: str):
        super().__init__(f"{field}: {cause}. {remedy}")
        self.cause = cause
        self.field = field
        self.remedy = remedy
