"""The builder's only exception: cause, field, remedy."""


class BuildError(Exception):
    """The input cannot become a bundle.

    `cause` is the fault, `field` the tensor, file or option that has it, `remedy` an action that avoids it.
    """

    def __init__(self, cause: str, *, field: str, remedy: str):
        super().__init__(f"{field}: {cause}. {remedy}")
        self.cause = cause
        self.field = field
        self.remedy = remedy
