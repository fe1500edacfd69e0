"""A piece of a rollout as a film, which a notebook plays."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Self

from . import _display
from ._library import whole
from .errors import refuse
from .pictures import Bytes
from .rollout import Anchor

_MOST_COLUMNS = 8


class Film:
    """Pictures of one size, `uint8` `[height, width, 4]`, and their rate per second. A notebook plays it in an endless loop; `strip()` shows
    its pictures side by side.

        cairn.Film.of_anchors(rollout.play([cairn.Controls(keys=["W"])] * 15))

    `pictures` and `rate` may be changed; pictures are not copied.
    """

    def __init__(self, pictures: Iterable[Bytes], rate: int) -> None:
        """Raises `InvalidArgument` for no pictures, pictures of another type or of different sizes, and an invalid rate."""
        self.pictures: Sequence[Bytes] = list(pictures)
        self.rate = rate
        self._require()

    @classmethod
    def of_anchors(cls, anchors: Iterable[Anchor], rate: int | None = None) -> Self:
        """Makes a film of all pictures of the anchors, and closes each anchor. If `rate` is `None`, it is the rate of the anchors' world, or 15
        per second for pictures of your own.
        """
        pictures: list[Bytes] = []
        own: int | None = None
        for anchor in anchors:
            with anchor:
                pictures += anchor.pictures()
                info = anchor.info
                # A seed's anchor may have fewer pictures than the later ones, so the last one decides.
                own = info.latents_per_second * info.pictures or 15
        return cls(pictures, rate if rate is not None else own or 15)

    def _require(self) -> None:
        if not self.pictures:
            raise refuse("pictures", "are none", "Give at least one, or anchors of a rollout that has made some")
        for picture in self.pictures:
            kind, shape = getattr(picture, "dtype", type(picture).__name__), tuple(getattr(picture, "shape", ()))
            if kind != "uint8" or len(shape) != 3 or shape[2] != 4 or 0 in shape:
                raise refuse("pictures", f"are {kind} {list(shape)}", "Give uint8 [height, width, 4], as Anchor.picture() does")
            if shape != self.pictures[0].shape:
                raise refuse("pictures", f"are of different sizes, {list(self.pictures[0].shape)} and {list(shape)}", "Give one size")
        self.rate = whole("rate", self.rate, 1, 65535, "Give pictures a second, a whole number from 1 to 65535")

    def __len__(self) -> int:
        return len(self.pictures)

    def png(self) -> bytes:
        """An animated PNG file; viewers without support for animation show the first picture."""
        self._require()
        return _display.animation(self.pictures, self.rate)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes `png()` to a file."""
        Path(path).write_bytes(self.png())

    def strip(self, columns: int = _MOST_COLUMNS, *, every: int = 1) -> Strip:
        """Its pictures side by side, `columns` to a row. With `every` above 1, only each `every`-th picture, beginning with the first."""
        if columns < 1 or every < 1:
            raise refuse("columns" if columns < 1 else "every", f"{min(columns, every)} is too small", "Give at least 1")
        self._require()
        return Strip(_display.contact_sheet(self.pictures[::every], columns))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        height, width, _ = self.pictures[0].shape
        text = f"film of {len(self)} pictures of {width}x{height} pixels, {self.rate} a second"
        return {"text/plain": text, "image/png": self.png()}


class Strip:
    """Pictures of a film combined into one picture, `uint8` `[height, width, 4]`, which a notebook shows."""

    def __init__(self, picture: Bytes) -> None:
        self.picture = picture

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to a PNG file."""
        Path(path).write_bytes(self._repr_png_())

    def _repr_png_(self) -> bytes:
        return _display.png(self.picture)
