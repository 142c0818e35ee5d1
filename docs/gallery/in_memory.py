"""Photographs that are arrays: a made pattern, turned by half a degree"""

import numpy as np

import dicflow
from dicflow.core.synthetic.planar import planar_pair

turn, middle = np.radians(0.5), np.array([150.0, 130.0])
rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
transform = np.eye(3)
transform[:2, :2], transform[:2, 2] = rotation, middle - rotation @ middle
pair = planar_pair((300, 260), transform, noise=1.0)
result = dicflow.measure(
    [pair.reference, pair.deformed],
    region=[[[40, 40], [260, 40], [260, 220], [40, 220]]],
    settings=["total.window=90 px"],
)
figure = dicflow.plot(result, "total", "rotation", step=0)
