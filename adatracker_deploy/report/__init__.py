"""HTML reports of trials: records become columns, columns become charts, charts become HTML.

Pure, except for `gather`, which reads. The page is self-contained: inline style and SVG, images as data, no
script and no external address. Every text goes through `markup`, which escapes it.
"""
