"""Run variants: on this machine, or on a cluster."""

from ...base.extras import require_extra

require_extra("analyses", "an analysis of many runs")
