"""Plots of the paper's figures 3 to 14 and 16 to 19, and of accuracy against moving fraction."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from mavhums.core.quantities import QUANTITIES
from mavhums.study.cyclograms import Flown
from mavhums.study.experiment import Experiment, emergency

__all__ = ["FIGURES_16_TO_19", "accuracy_figure", "output_figure", "quantities_figure"]

FIGURES_16_TO_19 = {16: 0.225, 17: 0.375, 18: 1.025, 19: 0.875}
"""The friction of each figure, N·m."""


def quantities_figure(flown: Flown) -> Figure:
    """Draw V1–V12 over the cyclogram (figures 3 to 14)."""
    figure = Figure(figsize=(13, 11), layout="constrained")
    for place, (axes, quantity) in enumerate(zip(figure.subplots(4, 3).flat, QUANTITIES, strict=True)):
        axes.plot(flown.time_s, flown.values[:, place], linewidth=0.7)
        axes.set_title(f"Figure {3 + place}: {quantity.key} {quantity.name}, {quantity.unit}", fontsize=9)
        axes.grid(alpha=0.3)
    figure.supxlabel("time, s")
    return figure


def output_figure(experiment: Experiment, flights: Sequence[Flown]) -> Figure:
    """Draw the network's output over the cyclogram at four frictions (figures 16 to 19)."""
    times = {flown.friction_nm: flown for flown in flights}
    figure = Figure(figsize=(13, 9), layout="constrained")
    for axes, (number, friction) in zip(figure.subplots(4, 1).flat, FIGURES_16_TO_19.items(), strict=True):
        flown = times[friction]
        axes.plot(flown.time_s, experiment.outputs[friction], linewidth=0.7, color="tab:red")
        wanted = "emergency" if emergency(flown) else "normal"
        axes.set_title(f"Figure {number}: T_c = {friction} N·m, {wanted}", fontsize=9)
        axes.set_ylim(-0.05, 1.05)
        axes.grid(alpha=0.3)
    figure.supylabel(f"probability of an emergency, inputs {', '.join(experiment.inputs)}")
    figure.supxlabel("time, s")
    return figure


def accuracy_figure(experiments: Sequence[Experiment]) -> Figure:
    """Draw the test flights' accuracies against their moving fractions, per sample and held."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots()
    for number, experiment in enumerate(experiments):
        flights = experiment.flights[experiment.flights["role"] == "test"]
        label = f"{experiment.cyclogram}, {len(experiment.inputs)} inputs"
        for name, marker in (("per_sample", "o"), ("held", "^")):
            axes.plot(
                flights["moving_fraction"],
                flights[name],
                marker,
                color=f"C{number}",
                fillstyle="full" if name == "held" else "none",
                label=f"{label}, {name.replace('_', ' ')}",
            )
    axes.set_xlabel("moving fraction of the flight")
    axes.set_ylabel("accuracy of the network chosen without test data, %")
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    return figure
