"""Reports: their content as plain data (`document`), views that make it from results, figures, and an HTML page.

The views of cascades and of physical models are in `emsid.report.views.cascade` and `emsid.report.views.grey_box`. They
are loaded when a section of such a model is made.

>>> from emsid.report.document import Report, Section
>>> from emsid.report.page import page
>>> page(Report("A motor", ("It turns.",), (Section("Data"),))).startswith("<!DOCTYPE html>")
True
"""
