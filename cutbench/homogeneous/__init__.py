"""Tests without a mesh: stretching, sliding and separation through the mechanism files of the runs.

    from cutbench.homogeneous import predict, slopes
    readings = predict(experiment, campaign.model, campaign.base.p, experiment.on_grid(80))

One model is so fitted to tension tests and to cutting curves together.
"""

from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.predict import predict, respond, scan, slopes

__all__ = ["LoadingHistory", "predict", "respond", "scan", "slopes"]
