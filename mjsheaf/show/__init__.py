"""A run as it is drawn, read once; video, page, export, live page and plots paint it.

Modules:

- played: what is where at each sample;
- solids: shapes of vehicles and obstacles;
- style: colours, scales, and settings of figure files;
- plots: the style of all figures, and the figures of a run.
"""
