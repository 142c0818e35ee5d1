"""The report: one HTML file that says what was measured, how good it is and where it comes from.

It needs no network and names no folder of the machine that made it. One module per section; :mod:`.build` puts them
into a page.
"""
