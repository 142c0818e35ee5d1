"""Motion of the picture in a series of photographs: when it moves, which photographs differ, how clocks are joined.

All of it is looked at from a few hundred features of small copies of the photographs, so that it says when something
moves rather than how far a point of the specimen moves.
"""
