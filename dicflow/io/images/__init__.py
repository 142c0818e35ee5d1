"""Photographs as cameras and people leave them: which files, which way up, which pixels, which belong together."""

from __future__ import annotations

from dicflow.io.images.formats import SUFFIXES
from dicflow.io.images.orientation import orientation_sentence, turned_upright, upright_size
from dicflow.io.images.pairing import Pairing, Unpaired, Way, counter_offset, natural_key, pair_names
from dicflow.io.images.reading import Photograph, page_count, probe, read_grey, read_photograph
from dicflow.io.images.search import search_start
from dicflow.io.images.series import find_photographs, steps_of
from dicflow.io.images.taken import time_taken

__all__ = [
    "SUFFIXES",
    "Pairing",
    "Photograph",
    "Unpaired",
    "Way",
    "counter_offset",
    "find_photographs",
    "natural_key",
    "orientation_sentence",
    "page_count",
    "pair_names",
    "probe",
    "read_grey",
    "read_photograph",
    "search_start",
    "steps_of",
    "time_taken",
    "turned_upright",
    "upright_size",
]
