"""Correlation of subsets: in time, and from left to right.

Words that all modules here use
-------------------------------
**First photograph**: where the grid of material points is laid out. **Reference photograph**: the one whose subsets
are searched for, as a **template**, in another one, the **target**. It is the first photograph as long as that works,
then the photograph of a **reference step** in between. **Previous step**: the step just before the one at hand.
**Warp**: how a subset of the reference photograph lies in the target.
"""
