"""Trials as one page to show: records become columns, columns become charts, charts become HTML.

Pure, but for `gather`, which reads. The page stands alone: inline style and SVG, pictures as data, no script
and no address that leaves it. Every text goes through `markup`, which escapes it.
"""
