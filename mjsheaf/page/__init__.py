"""One HTML file that replays a run in three dimensions next to its curves, on one clock, and loads nothing else.

Modules:

- page: the samples of a run and of others next to it, the other data of the page, and the file;
- page.html and bundle.js: the page itself. The bundle is built from web/ by `make bundle`, with three.js and uPlot in
  it, whose licences it carries.

A run's directory is all that it takes: `mjsheaf report DIR` writes the page again.

Whatever a scenario contains is data to the page: JSON without `<`, which scripts put into text nodes alone. The page's
content security policy allows the one script and the one style that it is written with, by their hashes, and no
connection at all.
"""

from mjsheaf.page.page import Ghost, bound_curves, page_of

__all__ = ["Ghost", "bound_curves", "page_of"]
