"""A measurement in the browser: it edits the pipeline file and its region, starts runs, and shows what the store holds.

The files stay the truth. Everything that a result depends on stands in them; beside them the folder ``.dicflow-app``
has earlier versions, for undo, and pictures that are made again when they are missing.
"""
