"""The builder's only exception: cause, field, remedy."""


class BuildError(Exception):
    """The input cannot become a bundle.

    `cause` is what is wrong, `field` is where (a tensor, a file, an option), `remedy` is what to do.
    """

    def __init__(self, cause: str, *, field: str, remedy: str):
        super().__init__(f"{field}: {cause}. {remedy}")
        self.cause = cause
        self.field = field
        self.remedy = remedy
