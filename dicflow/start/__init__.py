"""Before the first run: a first pipeline file, and a check of the machine."""
