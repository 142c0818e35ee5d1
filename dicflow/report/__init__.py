"""The report: one HTML file that says what was measured, how good it is and where it comes from.

It needs no network and names no folder of the machine that made it. :mod:`.build` puts the sections into a page.
A module ``name.py`` of this package, or an entry point ``name`` of the group ``dicflow.report_sections``, is a section
if it has

- ``PLACE``: a number, by which the page orders its sections;
- ``TITLE``: the heading;
- ``name(context)``: the :class:`~dicflow.report.context.Section`, None where a pipeline has nothing of the kind.
"""
