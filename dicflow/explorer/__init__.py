"""The explorer: the fields of a result in a browser, to be seen, asked and turned.

A result is read by :mod:`.fields` and packed by :mod:`.packing`; :mod:`.manifest` says what lies where. The page is
plain JavaScript in ``static``: the same component in a report, in a notebook, and served by fetch.
"""
