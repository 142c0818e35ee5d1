"""Text in pictures, in a font that matplotlib brings along."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

__all__ = ["Paper", "font_file", "line_height", "pitch", "text_width", "widest", "wrapped"]

_BLACK, _WHITE = 0, 255
_LEADING = 1.2


class Paper:
    """A white picture in grey levels, on which lines and texts are drawn in black.

    size : (width, height) [px]
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.image = Image.new("L", size, _WHITE)
        self._draw = ImageDraw.Draw(self.image)

    def text(self, x: float, y: float, text: str, size_px: float, anchor: str = "mm") -> None:
        """Write a line.

        anchor : what of it stands at (x, y): "l", "m" or "r" for left, middle or right, then "m" or "s" for middle or
            base line
        """
        self._draw.text((x, y), text, _BLACK, _font(size_px), anchor)

    def upright(self, x: float, y: float, text: str, size_px: float) -> None:
        """Write a line upwards with its middle at (x, y)."""
        width, height = round(text_width(text, size_px)) + 2, line_height(size_px)
        lying = Paper((width, height))
        lying.text(width / 2, height / 2, text, size_px)
        corner = (round(x - height / 2), round(y - width / 2))
        self.image.paste(lying.image.transpose(Image.Transpose.ROTATE_90), corner)

    def box(self, x: int, y: int, width: int, height: int) -> None:
        """Draw a line around a part of the picture."""
        self._draw.rectangle((x - 1, y - 1, x + width, y + height), None, _BLACK)

    def line(self, x: int, y: int, width: int, height: int) -> None:
        """Draw a line from (x, y) as far as is given, one of both being zero."""
        self._draw.line((x, y, x + width, y + height), _BLACK)


def text_width(text: str, size_px: float) -> float:
    """Width of a line [px]."""
    return _font(size_px).getlength(text)


def widest(texts: Iterable[str], size_px: float) -> int:
    """Width of the longest of some lines [px]."""
    return math.ceil(max((text_width(text, size_px) for text in texts), default=0.0))


def pitch(texts: Sequence[str], size_px: float) -> float:
    """Distance of the middles of neighbouring texts in a line that keeps them apart [px]."""
    widths = [text_width(text, size_px) for text in texts]
    return max((left + right for left, right in pairwise(widths)), default=0.0) / 2 + 0.3 * size_px


def line_height(size_px: float) -> int:
    """Distance of two lines [px]."""
    return round(_LEADING * size_px)


def wrapped(text: str, size_px: float, most_px: float) -> list[str]:
    """A text in lines of about so many pixels, as far as its words allow; a unit stays with the word before it."""
    letters = max(1, int(len(text) * most_px / max(1.0, text_width(text, size_px))))
    with_unit = text.replace(" [", "\N{NO-BREAK SPACE}[")
    return textwrap.wrap(with_unit, letters, break_long_words=False) or [""]


@cache
def font_file() -> str:
    """The file of a font that has the Greek letters of the measures; matplotlib, which brings it, is slow to load."""
    spec, name = find_spec("matplotlib"), Path("fonts", "ttf", "DejaVuSans.ttf")
    folders = [] if spec is None else spec.submodule_search_locations or []
    usual = [Path(folder, "mpl-data") / name for folder in folders]
    return str(next(filter(Path.is_file, usual), None) or _data_of_matplotlib() / name)


def _data_of_matplotlib() -> Path:
    import matplotlib

    return Path(matplotlib.get_data_path())


@cache
def _font(size_px: float) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(font_file(), size_px, layout_engine=ImageFont.Layout.BASIC)
