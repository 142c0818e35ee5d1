"""Kinds of product: one module for each, which names its arrays and attributes, writes them and reads them.

Stages write with ``X.write(…)`` and read with ``X.read(product)``; nobody else looks into the attributes of a product.
Modules load no numerics before a product is read.
"""
