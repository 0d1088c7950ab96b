"""A made-up diagnosis that names a gradient, for the tests of pages and comparisons."""

from wsp_env.diagnosis.answer import Diagnosis, Estimate, Evidence, FitQuality, Named, RunFigures, RunTrace


def figures_of(run: str, group: str) -> RunFigures:
    two = (0.5, 0.25)
    return RunFigures(run, group, (0.04, None), (0.02, None), 0.3, 0.2, two, two, two, two, two, two)


def named_gradient() -> Diagnosis:
    rise = {"rise": Estimate(-0.0089, "-", (-0.0097, -0.0081))}
    evidence = (
        Evidence("vehicle_mass", 200.0, (1.0, 3.0), 20.0, 100.0, 1.5),
        Evidence("track_gradient", 900.0, (2.0, 9.0), 90.0, 400.0, 4.0),
        Evidence("force on the vehicle over time", 950.0, (20.0, 40.0), 50.0, 0.0, 0.0),
    )
    cells = [
        {"balance": "vehicle", "run": run, "axle": 0, "before": 9.0, "after": after}
        for run, after in (("A1", 0.9), ("B1", 3.5))
    ]
    places = [{"balance": "vehicle", "axle": 0, "place_m": 100.0, "before": 9.0, "after": 1.0}]
    return Diagnosis(
        campaign="trial",
        verdict="named",
        sentence="What the simulation lacks: the track falls by 8.9 per mille more than believed (8.1 to 9.7 per mille).",
        mechanisms=(Named("track_gradient", 0.99, ("track_gradient",), rise, 4.0, 900.0, 9.0, 400.0),),
        location=(),
        fit=FitQuality(1.0, {"tune": 5.0, "validate": 6.0}, {"tune": 1.1, "validate": 1.5}, 0.9),
        detectable={"track_gradient": {"rise": 3e-4}},
        next_test="coasting over the same track in both directions",
        evidence=evidence,
        model={},
        residuals={"cells": cells, "places": places},
        runs=(figures_of("A1", "tune"), figures_of("B1", "validate")),
        notes=(),
        course=RunTrace("B1", "validate", 2, (0.0, 1.0), (0.1, 0.11), (0.09, 0.1), (0.1, 0.11), (0.0, 1.0), (0.2, 0.3),
                      (0.0, 0.1)),
    )  # fmt: skip
