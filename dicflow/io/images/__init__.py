"""Photographs as cameras and people leave them: which files, which way up, which pixels, which belong together."""

from __future__ import annotations

from dicflow.io.images.clocks import joined_clocks
from dicflow.io.images.formats import ALL_SUFFIXES, RAW_SUFFIXES, is_video
from dicflow.io.images.moments import moment_of, read_times, utc_offset_of
from dicflow.io.images.orientation import orientation_sentence, turned_upright, upright_size
from dicflow.io.images.pairing import Pairing, Unpaired, Way, counter_offset, natural_key, pair_names
from dicflow.io.images.reading import Photograph, page_count, probe, read_grey, read_photograph
from dicflow.io.images.search import search_start
from dicflow.io.images.selection import Selection, selected
from dicflow.io.images.series import find_photographs, steps_of, video_sentences
from dicflow.io.images.taken import camera_model, time_taken
from dicflow.io.images.video import video_of

__all__ = [
    "ALL_SUFFIXES",
    "RAW_SUFFIXES",
    "Pairing",
    "Photograph",
    "Selection",
    "Unpaired",
    "Way",
    "camera_model",
    "counter_offset",
    "find_photographs",
    "is_video",
    "joined_clocks",
    "moment_of",
    "natural_key",
    "orientation_sentence",
    "page_count",
    "pair_names",
    "probe",
    "read_grey",
    "read_photograph",
    "read_times",
    "search_start",
    "selected",
    "steps_of",
    "time_taken",
    "turned_upright",
    "upright_size",
    "utc_offset_of",
    "video_of",
    "video_sentences",
]
