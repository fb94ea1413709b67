"""Reports: runs, sweeps and studies, each as one HTML page that needs no network."""

from optim.report.assembly import MOST_BYTES, Built, ReportSettings, build

__all__ = ["MOST_BYTES", "Built", "ReportSettings", "build"]
