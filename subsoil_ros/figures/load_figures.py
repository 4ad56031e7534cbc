"""Figures of loads and disturbance: spectra, load cycles, loosened section, height map."""

from pathlib import Path

import numpy as np

from ..analysis.disturbance import Disturbance
from ..analysis.fatigue import LoadCycles
from ..analysis.run_statistics import RunStatistics
from ..analysis.spectra import Spectrum
from ..report.sentences import significance_words
from .plotting import COLOURS, new_figure, save_figure

_CYCLE_BINS = 24


def draw_load_figures(statistics: RunStatistics, title: str, directory: Path) -> list[Path]:
    """Draw the figures of the statistics that the run has into `directory`; return the paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    if statistics.spectra:
        paths.append(_draw_spectra(statistics.spectra, title, directory / "spectra.png"))
    if statistics.cycles is not None and len(statistics.cycles.range_newton):
        paths.append(_draw_cycles(statistics.cycles, title, directory / "load_cycles.png"))
    if statistics.disturbance is not None:
        paths.append(_draw_disturbance(statistics.disturbance, title, directory / "disturbance.png"))
    return paths


def _draw_spectra(spectra: dict[str, Spectrum], title: str, path: Path) -> Path:
    figure = new_figure(9.0, 2.6 * len(spectra) + 0.8)
    panels = figure.subplots(len(spectra), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, found) in zip(panels, spectra.items(), strict=True):
        rows = slice(1, None)
        frequency = found.frequency_hz[rows]
        axes.fill_between(
            frequency, found.low[rows], found.high[rows], color=COLOURS["main"], alpha=0.25, lw=0.0,
            label="95 % (chi-square)",
        )  # fmt: skip
        axes.loglog(frequency, found.density[rows], color=COLOURS["main"], lw=1.2, label="Welch")
        axes.loglog(
            frequency,
            found.level[rows],
            color=COLOURS["reference"],
            lw=1.0,
            ls="--",
            label="red noise, 95 % anywhere",
        )
        axes.axvline(
            found.dominant_hz,
            color=COLOURS["share"],
            lw=1.0,
            label=f"{found.dominant_hz:.2f} Hz, {significance_words(found)}",
        )
        axes.set_title(name, fontsize=9, loc="left")
        axes.set_ylabel("density [unit$^2$/Hz]")
        axes.minorticks_off()  # of 300 ticks most would have neither label nor room
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    panels[-1].set_xlabel("frequency [Hz]")
    figure.suptitle(f"Spectra over the metrics window\n{title}", fontsize=11)
    return save_figure(figure, path)


def _draw_cycles(cycles: LoadCycles, title: str, path: Path) -> Path:
    figure = new_figure(9.0, 4.2)
    axes = figure.add_subplot()
    edges = np.linspace(0.0, cycles.max_range_newton, _CYCLE_BINS + 1)
    axes.hist(cycles.range_newton, bins=edges.tolist(), weights=cycles.count, color=COLOURS["main"])
    equivalent = cycles.equivalent_range_newton()
    axes.axvline(equivalent, color=COLOURS["share"], label=f"same damage as {equivalent:.0f} N once a second")
    axes.set_yscale("log")
    axes.set_xlabel("range of the spring force [N]")
    axes.set_ylabel("cycles")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    axes.set_title(f"Load cycles of the spring (rainflow, ASTM E1049)\n{title}", fontsize=11)
    return save_figure(figure, path)


def _draw_disturbance(found: Disturbance, title: str, path: Path) -> Path:
    figure = new_figure(10.0, 9.5)
    section, surface, along = figure.subplots(3, 1)
    rows, columns = found.moved_map.shape
    y_low, z_low = found.origin_m
    extent = (y_low, y_low + columns * found.cell_m, z_low, 0.0)
    image = section.imshow(
        found.moved_map, origin="lower", extent=extent, cmap="viridis", vmin=0.0, vmax=1.0, aspect="equal"
    )
    figure.colorbar(image, ax=section, label="part moved by more than a radius")
    section.set_xlabel("across travel, y [m]")
    section.set_ylabel("height before [m]")
    section.set_title(
        f"loosened {1e4 * found.area_m2:.0f} cm$^2$, surface {1e3 * found.surface_width_m:.0f} mm wide",
        fontsize=10, loc="left",
    )  # fmt: skip
    lift = found.lift
    (x, y), (rows, columns) = lift.origin_m, lift.height_m.shape
    largest = max(1e-3, float(np.nanmax(np.abs(lift.height_m))))
    image = surface.imshow(
        1e3 * lift.height_m, origin="lower", cmap="RdBu_r", vmin=-1e3 * largest, vmax=1e3 * largest,
        extent=(x, x + columns * lift.cell_m, y, y + rows * lift.cell_m), aspect="equal",
    )  # fmt: skip
    figure.colorbar(image, ax=surface, label="lift [mm]")
    surface.set_xlabel("along travel, x [m]")
    surface.set_ylabel("across travel, y [m]")
    surface.set_title("height of the surface, after less before", fontsize=10, loc="left")
    along.plot(found.slices_m, 1e4 * found.slice_m2, drawstyle="steps-mid")
    along.set_xlabel("along travel, x [m]")
    along.set_ylabel("loosened section [cm$^2$]")
    along.set_ylim(bottom=0.0)
    along.grid(alpha=0.3)
    figure.suptitle(f"Disturbance of the soil behind the tool\n{title}", fontsize=11)
    return save_figure(figure, path)
