"""The explorer: the fields of a result in a browser, to be seen, asked and turned.

A result is read by :mod:`.fields`, its numbers are packed by :mod:`.packing`, and :mod:`.manifest` says what lies where.
The page is plain JavaScript in ``static``: the same component in a report, in a notebook, and served by fetch.
"""
