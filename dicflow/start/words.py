"""Words in the names of folders and files that tell cameras apart, and boards from specimens."""

from __future__ import annotations

import re
import unicodedata

__all__ = ["BOARD_WORDS", "DEVICES", "FIRST_WORDS", "LEFT_RIGHT", "ORDINALS", "REGION_WORDS", "SIDES", "words"]

LEFT_RIGHT = (
    ("left", "right"),
    ("l", "r"),
    ("lt", "rt"),
    ("links", "rechts"),
    ("linke", "rechte"),
    ("linker", "rechter"),
    ("linkes", "rechtes"),
    ("li", "re"),
    ("gauche", "droite"),
    ("gauche", "droit"),
    ("g", "d"),
    ("izquierda", "derecha"),
    ("izquierdo", "derecho"),
    ("izq", "der"),
    ("izq", "dch"),
    ("izq", "dcha"),
    ("izda", "dcha"),
    ("i", "d"),
    ("sinistra", "destra"),
    ("sinistro", "destro"),
    ("sin", "des"),
    ("sx", "dx"),
    ("s", "d"),
    ("esquerda", "direita"),
    ("esquerdo", "direito"),
    ("esq", "dir"),
    ("e", "d"),
    ("lewa", "prawa"),
    ("lewy", "prawy"),
    ("leva", "prava"),
    ("levy", "pravy"),
    ("vanster", "hoger"),
    ("venstre", "høyre"),
    ("venstre", "højre"),
    ("vasen", "oikea"),
    ("linkse", "rechtse"),
    ("bal", "jobb"),
    ("stanga", "dreapta"),
    ("sol", "sag"),
    ("kiri", "kanan"),
    ("левая", "правая"),
    ("левыи", "правыи"),
    ("лево", "право"),
    ("左", "右"),
    ("왼쪽", "오른쪽"),
    ("αριστερα", "δεξια"),
    ("αριστερη", "δεξια"),
    ("שמאל", "ימין"),
    ("يسار", "يمين"),
)
"""Words for left and right, in small letters and without accents, as :func:`words` gives them."""

SIDES = (
    *LEFT_RIGHT,
    ("master", "slave"),
    ("primary", "secondary"),
    ("port", "starboard"),
    ("upper", "lower"),
    ("top", "bottom"),
    ("oben", "unten"),
)
"""Words for the left and the right camera; of cameras above one another the upper one first."""

DEVICES = frozenset({
    "cam", "camera", "cameras", "kamera", "camara", "telecamera", "fotocamera", "appareil", "apparat", "kameras",
    "phone", "iphone", "smartphone", "handy", "telefon", "telefono", "telephone", "pixel", "galaxy", "samsung",
    "huawei", "xiaomi", "redmi", "oneplus", "oppo", "motorola", "nokia", "xperia", "gopro", "gopr", "hero", "insta",
    "raspicam", "picam", "rpi", "raspi", "webcam", "dslr", "canon", "nikon", "sony", "fuji", "fujifilm", "lumix",
    "panasonic", "olympus", "pentax", "leica", "eos", "basler", "flir", "ximea", "ids", "ueye",
    "mako", "manta", "blackfly", "grasshopper", "device", "sensor", "view", "views", "eye", "head", "lens", "objektiv",
    "objectif", "kopf", "vue", "vista", "blick",
})  # fmt: skip
"""Words for a camera or what holds one; a number or letter beside it names a camera."""

ORDINALS = frozenset({
    "one", "two", "first", "second", "eins", "zwei", "erste", "zweite", "un", "deux", "uno", "dos", "due", "um", "dois",
})  # fmt: skip
"""Words that number two devices."""

BOARD_WORDS = frozenset({
    "board", "boards", "calib", "calibs", "calibration", "calibrations", "calibrate", "cal", "cali", "checker",
    "checkers", "checkerboard", "chess", "chessboard", "charuco", "aruco", "target", "targets", "grid", "grids", "dot",
    "dots", "circle", "circles", "kalib", "kalibrierung", "kalibration", "kalibrieren", "schachbrett", "tafel",
    "etalonnage", "calibrage", "damier", "mire", "echiquier", "calibracion", "damero", "tablero", "ajedrez",
    "calibrazione", "taratura", "scacchiera", "calibracao", "tabuleiro", "kalibracja", "szachownica", "kalibrace",
    "sachovnice", "kalibrering", "калибровка", "доска", "标定", "棋盘", "校准",
})  # fmt: skip
"""Words for photographs of a calibration target."""

FIRST_WORDS = frozenset({
    "ref", "reference", "referenz", "undeformed", "unloaded", "initial",
})  # fmt: skip
"""Words for the photograph of the specimen without load."""

REGION_WORDS = frozenset({
    "roi", "mask", "maske", "masque", "mascara", "region",
})  # fmt: skip
"""Words for pictures that mark a region."""

_RUN = re.compile(r"\d+|[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_MIN_GLUED = 4
_KNOWN = DEVICES | BOARD_WORDS | {word for pair in SIDES for word in pair}
_GLUED = sorted(
    {word for pair in SIDES for word in pair if len(word) >= _MIN_GLUED or not word.isascii()}, key=len, reverse=True
)


def words(name: str) -> tuple[str, ...]:
    """Words and numbers of a name, in small letters and without accents or leading zeros.

    >>> words("Kamera-Größe2_ImageLeft_007")
    ('kamera', 'grosse', '2', 'image', 'left', '7')
    """
    decomposed = unicodedata.normalize("NFKD", name)
    plain = "".join(sign for sign in decomposed if not unicodedata.combining(sign))
    return tuple(word for run in _RUN.findall(unicodedata.normalize("NFC", plain)) for word in _parts(run))


def _parts(run: str) -> tuple[str, ...]:
    """The words of a run of letters, or the number of a run of digits."""
    if run.isdecimal():
        return (str(int(run)),)
    whole = run.casefold()
    if whole in _KNOWN:
        return (whole,)
    return tuple(part for piece in _CAMEL.split(run) for part in _unglued(piece.casefold()))


def _unglued(word: str) -> tuple[str, ...]:
    """A word without separators taken apart at the word of a side, or before a letter after a device or board."""
    if word in _KNOWN:
        return (word,)
    for side in _GLUED:
        if word.endswith(side):
            return (*_unglued(word.removesuffix(side)), side)
        if word.startswith(side):
            return (side, *_unglued(word.removeprefix(side)))
    return (word[:-1], word[-1]) if word[:-1] in DEVICES | BOARD_WORDS else (word,)
