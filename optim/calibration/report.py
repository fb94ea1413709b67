"""What a calibration says: a document for machines and files, a table for people."""

from typing import Any

from optim.calibration.fit import Calibration
from robots.calibration import UNITS

TOO_LARGE = 2.0  # residuals in standard deviations, from which on model and data do not agree


def document(found: Calibration, geometry: str) -> dict[str, Any]:
    """All of it; fits JSON, and ``robots.calibration.load_calibration`` reads it."""
    fitted = {
        name: {
            "before": getattr(found.before, name),
            "after": getattr(found.after, name),
            "unit": UNITS[name],
            "relative_standard_error": float(error),
            "interval_95": [float(low), float(high)],
            "part_of_variance_by_chaos": float(chaos),
            "at_bound": name in found.at_bound,
        }
        for name, error, (low, high), chaos in zip(
            found.names, found.uncertainty.errors, found.intervals, found.uncertainty.chaos, strict=True
        )
    }
    return {
        "geometry": geometry,
        "properties": vars(found.after),
        "fitted": fitted,
        "correlation": found.uncertainty.correlation.tolist(),
        "misfit_before": _finite(found.misfit[0]),
        "misfit_after": _finite(found.misfit[1]),
        "noise": found.uncertainty.noise,
        "warnings": warnings(found),
    }


def warnings(found: Calibration) -> list[str]:
    """What a user must know before trusting the numbers, a line each."""
    lines = [f"{name} ended at a bound: its error means little; widen --bounds {name}" for name in found.at_bound]
    if found.uncertainty.noise > TOO_LARGE:
        size = f"{found.uncertainty.noise:.1f} standard deviations"
        lines.append(f"the residuals are {size}: the model misses something, or the deviations are too small")
    return lines


def table(found: Calibration) -> str:
    """Properties, intervals and correlations in columns, then warnings."""
    rows = [f"{'property':<16}{'before':>10}{'after':>10}{'error':>8}  {'95 % interval':<26}{'correlation'}"]
    for row, (name, error, (low, high)) in enumerate(
        zip(found.names, found.uncertainty.errors, found.intervals, strict=True)
    ):
        before, after = (f"{getattr(p, name):.4g}" for p in (found.before, found.after))
        interval = f"{low:.4g} to {high:.4g} {UNITS[name]}"
        others = " ".join(f"{value:5.2f}" for value in found.uncertainty.correlation[row, : row + 1])
        rows.append(f"{name:<16}{before:>10}{after:>10}{100 * error:>6.1f} %  {interval:<26}{others}")
    rows.append(
        f"residuals (root mean square): {found.misfit[0]:.3g} standard deviations before, {found.misfit[1]:.3g} after"
    )
    return "\n".join(rows + [f"warning: {line}" for line in warnings(found)])


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
