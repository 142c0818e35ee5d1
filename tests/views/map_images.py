"""Pictures of maps, as tests look at them."""

from io import BytesIO

import matplotlib
import numpy as np
from PIL import Image


def opened(content):
    """The picture that some bytes hold."""
    image = Image.open(BytesIO(content))
    image.load()
    return image


def colour_of(image, colour):
    """Share of the pixels near a colour of the map, given by its place from 0 to 1."""
    expected = 255 * np.array(matplotlib.colormaps["viridis"](colour)[:3])
    return (np.abs(np.asarray(image.convert("RGB"), float) - expected).max(axis=-1) < 6).mean()


def is_whole(image):
    """Whether nothing reaches the picture's edge, and so nothing is cut off."""
    grey = np.asarray(image.convert("L"))
    return min(edge.min() for edge in (grey[:4], grey[-4:], grey[:, :4], grey[:, -4:])) == 255
