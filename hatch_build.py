"""Fetch uPlot, which draws the plots of the studio, before a wheel, an sdist or an editable installation is built.

Without npm the package is built all the same; ``emsid studio`` then says how to get uPlot.
"""

from __future__ import annotations

import runpy
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class FetchPlots(BuildHookInterface[Any]):
    """Fetches uPlot with npm, verified, unless it is there."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Fetch it."""
        uplot = runpy.run_path("src/emsid/studio/uplot.py")
        try:
            if not uplot["is_there"]():
                uplot["fetch"]()
        except uplot["NotFetched"] as problem:
            self.app.display_warning(f"the studio is built without its plots: {problem}")
