"""A local page in the browser: data, models, comparison and play, on the same functions as the command line.

`emsid.studio.server` answers requests on the loopback interface, each identification runs in a process of its own
(`emsid.studio.worker`), and everything that was done is a folder (`emsid.studio.session`). The page is in ``page/``.
"""
