"""The textbook: pure functions on arrays.

Conventions
-----------
**Pixels** are (x right, y down), pixel centres at integers; point arrays hold (x, y) on their last axis,
images are indexed ``[row, col] = [y, x]``. **World** is camera 0 (left): X right, Y down, Z away [mm].
A point in the frame of camera 1 (right) is ``X1 = R @ X0 + T``. **Distortion** is (k1, k2, p1, p2, k3).

Last axes are components, leading axes are batch. A missing value is NaN, and a
:class:`~dicflow.core.status.Status` beside it gives the reason.
"""
