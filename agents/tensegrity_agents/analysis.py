"""Analyses of mechanisms: figures, regions as GeoJSON, numbers and a page for browsing, one folder per design.

`ANALYSES` is the table of mechanisms that can be analysed; a new one is one more row.
"""

import csv
import dataclasses
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure

from tensegrity_agents import env_options
from tensegrity_agents.reporting import analysis_dual_triangle as dual
from tensegrity_agents.reporting import analysis_planar_four_bar as four_bar
from tensegrity_agents.reporting import analysis_spatial_prism as spatial
from tensegrity_agents.reporting import analysis_two_x as draw
from tensegrity_agents.reporting.analysis_page import write_page
from tensegrity_agents.reporting.browse_mechanisms import dual_triangle_page, four_bar_page, spatial_prism_page
from tensegrity_agents.reporting.figures import save
from tensegrity_envs.mechanics import accessibility, workspace
from tensegrity_envs.mechanics.dual_triangle import (
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
    DualTriangle,
    DualTriangleDesign,
)
from tensegrity_envs.mechanics.overlay import closed, feature_collection
from tensegrity_envs.mechanics.planar_four_bar import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.workspace import MODES, actuator_workspace, output_workspace
from tensegrity_envs.mechanics.spatial_prism import JAHROMY, TRAJECTORIES, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.two_x import FURET2018, MURALIDHARAN2022, TwoX, TwoXDesign

Progress = Callable[[str, int, int, str], None]
Numbers = dict[str, float | int | bool | str]


@dataclass(frozen=True)
class Analysis:
    """One mechanism's analysis.

    Attributes:
        what: it computes, in words.
        designs: named designs; more can be given as YAML files.
        default: names of designs that are analysed if none is given, with their changed fields.
        run: (designs by folder name, output folder, progress) -> numbers by folder name.
    """

    what: str
    designs: Mapping[str, Callable[[], Any]]
    default: tuple[str, ...]
    run: Callable[[Mapping[str, Any], Path, Progress], dict[str, Numbers]]


def parse_design(text: str, named: Mapping[str, Callable[[], Any]]) -> tuple[str, Any]:
    """A design from "name,field=value,...", or "file.yaml,field=value,..." with the design's fields in the file.

    Args:
        text: such as "muralidharan2022,payload=0.5".
        named: designs by name.

    Returns:
        A name for its folder, and the design.

    Raises:
        ValueError: unknown name or field, a value that is not a number, or a design that is not valid.
    """
    base_name, values = _read_design(text, named)
    base = named[base_name]()
    fields = {field.name for field in dataclasses.fields(base)}
    if unknown := sorted(str(name) for name in values if name not in fields):
        raise ValueError(f"--design {text}: unknown {', '.join(unknown)}; the fields are {', '.join(sorted(fields))}")
    try:
        design = replace(base, **values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"--design {text}: {error}") from error
    first, *changes = (part.strip() for part in text.split(","))
    stem = Path(first).stem if first not in named else first
    return re.sub(r"[^A-Za-z0-9_.=-]+", "_", "_".join([stem, *changes])), design


def _read_design(text: str, named: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The name of the design that other fields come from, and the fields that are given."""
    given = env_options.parse_design(text)
    if isinstance(given, str):
        given = {"base": given}
    base = given.pop("base", next(iter(named)))
    if base not in named:
        raise ValueError(
            f"--design {text}: must begin with one of {', '.join(named)}, or with the name of a YAML file; or name one "
            "of them as 'base'"
        )
    return str(base), given


def notes_on_designs(mechanism: str, designs: Sequence[str]) -> list[str]:
    """Lines that say from which designs those fields come that are not given.

    Raises:
        ValueError: unknown mechanism, or see `parse_design`.
    """
    notes = []
    for text in designs:
        named = _analysis_of(mechanism).designs
        parse_design(text, named)
        base, given = _read_design(text, named)
        if given:
            changed = ", ".join(f"{name} = {value!r}" for name, value in given.items())
            notes.append(f"{text}: {changed}; all other fields are those of {base}")
    return notes


def _analysis_of(mechanism: str) -> Analysis:
    if mechanism not in ANALYSES:
        raise ValueError(f"unknown mechanism {mechanism!r}: there are analyses of {', '.join(ANALYSES)}")
    return ANALYSES[mechanism]


def analyze(mechanism: str, designs: Sequence[str], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Analyse designs of a mechanism and write everything to `out`, a folder for each design.

    Args:
        mechanism: a key of `ANALYSES`.
        designs: see `parse_design`; none for the mechanism's published ones.
        out: folder, made if it is missing.
        progress: (what, done, total, remark).

    Returns:
        Numbers of each design.

    Raises:
        ValueError: unknown mechanism, or see `parse_design`.
    """
    chosen = _analysis_of(mechanism)
    parsed = dict(parse_design(text, chosen.designs) for text in (designs or chosen.default))
    numbers = chosen.run(parsed, out, progress)
    for name, table in numbers.items():
        _write_numbers(table, out / name)
    return numbers


def _write_numbers(table: Numbers, folder: Path) -> None:
    with (folder / "numbers.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["quantity", "value"])
        writer.writerows(table.items())
    lines = ["| quantity | value |", "|---|---:|", *(f"| {name} | {as_text(value)} |" for name, value in table.items())]
    (folder / "numbers.md").write_text("\n".join(lines) + "\n")


def as_text(value: float | int | bool | str) -> str:
    """A number for a table: seven digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def _write_geojson(features: Sequence[Mapping[str, Any]], path: Path, **properties: Any) -> None:
    path.write_text(json.dumps(feature_collection(features, **properties)))


TITLES = {
    "muralidharan_fig3_boundary_points": "Boundary points of the stable wrench-feasible joint space",
    "muralidharan_fig4_swfj_swfw": "Stable wrench-feasible joint space and workspace",
    "active_conditions": "What bounds the stable wrench-feasible set",
    "furet_fig3_boundaries": "Regions by number of inverse solutions",
    "furet_fig4_inverse_solutions": "All inverse solutions",
    "furet_fig6_regions_by_type": "Regions by types of inverse solutions",
    "furet_fig7_joint_limits": "Regions by number of inverse solutions within joint limits",
    "posture_change": "A change of posture without a singularity",
    "zhao_fig2_torque": "Torque of the springs of a segment",
    "zhao_fig3_control": "Control input and its sensitivity",
    "zhao_fig5_redundancy": "Postures by three objectives",
    "zhao_fig6_control_over_targets": "Control inputs along lines of targets",
    "buckling": "Straight and buckled equilibria under an axial push",
    "loaded_workspace": "Where the tip can be held under an axial push",
    "critical_load": "Critical push by tip position",
    "ji_fig2_actuator_workspace": "Actuator workspace",
    "ji_fig3_output_workspace": "Output workspace by mode",
    "singular_configurations": "Singular configurations",
    "thrusts": "Thrusts of the actuators",
    "energy_landscape": "Energy and equilibria",
    "jahromy_fig4_forces_eq31": "Forces along the trajectory of Eq. 31",
    "jahromy_fig5_forces_eq32": "Forces along the trajectory of Eq. 32",
    "compliance": "Compliance of the unloaded platform",
    "unloading_limits": "Smallest force at which something goes slack",
    "unloading_directions": "Force at which something goes slack by its direction",
    "pictures": "The prism at rest and under load",
    "workspace": "Workspace without a load",
}


def _save(figure: Figure, stem: Path, remark: str = "") -> None:
    """Write a figure under its title and the name of its design, which is that of its folder."""
    name = "" if stem.name == "furet_fig3_boundaries" else stem.parent.name
    save(figure, stem, ": ".join(part for part in (name, TITLES[stem.name] + remark) if part))


class _Steps:
    """Progress of one design, a step at a time."""

    def __init__(self, name: str, total: int, progress: Progress) -> None:
        self.name, self.total, self.progress, self.done = name, total, progress, 0

    def __call__(self, remark: str) -> None:
        self.progress(self.name, self.done, self.total, remark)
        self.done += 1

    def finish(self) -> None:
        self.progress(self.name, self.total, self.total, "done")


def _analyze_two_x(designs: Mapping[str, TwoXDesign], out: Path, progress: Progress) -> dict[str, Numbers]:
    numbers: dict[str, Numbers] = {}
    plain: dict[str, accessibility.Accessibility] = {}
    for name, design in designs.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        mechanism = TwoX(design)
        loaded = any((design.k1, design.k2, design.payload, design.bar_density))  # else purely kinematic
        bare = not design.a or not loaded
        step = _Steps(name, 6 * loaded + 5 * bare, progress)
        numbers[name] = {}
        if loaded:
            numbers[name] |= _stable_set(mechanism, name, folder, step)
        if bare:
            limit = 2 * math.pi if not design.a else math.pi
            kinematic = TwoX(replace(design, joint_limit=min(design.joint_limit, limit)))
            plain[name] = _accessibility(kinematic, folder, step)
            numbers[name] |= accessibility.summary(plain[name])
            if not loaded:
                _page_of_solutions(plain[name], folder, name)
        step.finish()
    if plain:
        titles = {f"L = {a.mechanism.design.l:g}, b = {a.mechanism.design.b:.4g}": a for a in plain.values()}
        _save(draw.workspace_boundaries(titles), out / "furet_fig3_boundaries")
    return numbers


def _stable_set(mechanism: TwoX, name: str, folder: Path, step: Callable[[str], None]) -> Numbers:
    step("stable wrench-feasible joint space")
    region = workspace.stable_wrench_feasible_joint_space(mechanism)
    traced = region.trace()
    cloud = workspace.boundary_cloud(mechanism)
    step("workspace")
    found = workspace.stable_wrench_feasible_workspace(mechanism)
    step("slice")
    intervals = region.slices(1, 0.0)[0]
    step("figures")
    figures: dict[str, Figure] = {
        "muralidharan_fig3_boundary_points": draw.boundary_scan(mechanism, intervals, 0.0, cloud),
        "muralidharan_fig4_swfj_swfw": draw.stable_sets(mechanism, cloud, traced, found),
        "active_conditions": draw.active_conditions(mechanism, traced, found),
    }
    for stem, figure in figures.items():
        _save(figure, folder / stem)
    step("regions")
    _write_geojson(traced.to_features(), folder / "swfj.geojson", coordinates="alpha_1, alpha_2 [rad]")
    _write_geojson(found.to_features(), folder / "swfw.geojson", coordinates="x, y [m]")
    step("table")
    with (folder / "boundary_points.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["alpha_1", "alpha_2", "x", "y", "condition", "fixed angle", "det J"])
        rows = zip(cloud.points, cloud.tips, cloud.conditions, cloud.fixed, cloud.determinant, strict=True)
        writer.writerows([*q.tolist(), *p.tolist(), what, int(k) + 1, float(d)] for q, p, what, k, d in rows)
    sheets = [closed(ring) for sheet in found.sheets for ring in sheet.rings]
    folds = [closed(ring.points) for ring in found.sheets[0].source.rings]
    edges = [closed(ring.points) for ring in traced.rings]
    write_page(
        folder / "browse.html",
        f"Stable wrench-feasible workspace: {name}",
        mechanism,
        found.regions,
        {"boundary": sheets},
        {"singular": folds, "boundary": edges},
        region.upper[0],
        region,
    )
    table: Numbers = dict(workspace.summary(traced, found))
    for k, interval in enumerate(intervals):
        text = f"[{interval.low:.12f} ({interval.low_condition}), {interval.high:.12f} ({interval.high_condition})]"
        table[f"alpha_1 on the slice alpha_2 = 0, interval {k + 1} [rad]"] = text
    return table


def _accessibility(mechanism: TwoX, folder: Path, step: Callable[[str], None]) -> accessibility.Accessibility:
    step("regions by inverse solutions")
    found = accessibility.accessibility(mechanism)
    _write_geojson(found.to_features(), folder / "accessibility.geojson", coordinates="x, y [m]")
    step("inverse solutions")
    target = _showpiece(found)
    solutions = mechanism.inverse_kinematics(*target)
    where = f" with the tip at ({target[0]:.4g}, {target[1]:.4g}) m"
    _save(draw.inverse_solutions(mechanism, solutions, target), folder / "furet_fig4_inverse_solutions", where)
    step("figures")
    _save(draw.regions_by_type(found), folder / "furet_fig6_regions_by_type")
    step("joint limits")
    narrow = min(float(mechanism.design.joint_limit), 2 * math.pi / 3)  # theta within pi / 3, as in the paper
    limited = accessibility.accessibility(TwoX(replace(mechanism.design, joint_limit=narrow)))
    _save(draw.joint_limited(limited), folder / "furet_fig7_joint_limits")
    _write_geojson(limited.to_features(), folder / "joint_limits.geojson", coordinates="x, y [m]")
    step("posture change")
    if not mechanism.design.a:
        for pair in accessibility.posture_pairs(mechanism, *target):
            try:
                path = accessibility.posture_change(mechanism, *pair)
            except ValueError:
                continue  # within joint limits two solutions of one sign may be in different aspects
            figure = draw.posture_change(found, path, accessibility.aspects(mechanism), pair[1])
            _save(figure, folder / "posture_change")
            np.savetxt(
                folder / "posture_change.csv",
                np.column_stack([path.configurations, path.tips, path.singularity]),
                delimiter=",",
                header="alpha_1,alpha_2,x,y,det J",
                comments="",
            )
            break
    return found


def _page_of_solutions(found: accessibility.Accessibility, folder: Path, name: str) -> None:
    m = found.mechanism
    pieces = [
        piece for chain in found.singular for piece in (accessibility.wrapped(chain) if not found.limits else [chain])
    ]
    limit = float(m.design.joint_limit)
    still = []  # where the tip stays at the base
    if not m.design.a and limit > math.pi:
        for total in (-2 * math.pi, 2 * math.pi):
            ends = np.array([max(-limit, total - limit), min(limit, total + limit)])
            still.append(np.column_stack([ends, total - ends]))
    curves = {"flat": list(found.flat.values()), "limit": list(found.limits), "singular": list(found.singular)}
    write_page(
        folder / "browse.html",
        f"Inverse solutions: {name}",
        m,
        found.by_count,
        {kind: [accessibility.tip_curve(m, chain) for chain in chains] for kind, chains in curves.items()},
        {"singular": pieces, "self-motion": still},
        limit,
    )


def _showpiece(found: accessibility.Accessibility) -> tuple[float, float]:
    """A tip position with as many inverse solutions as there are: the paper's (0, L) where it has them."""
    l = float(found.mechanism.design.l)
    if not found.by_count:
        return 0.0, l
    most = max(found.by_count)
    if most == len(found.mechanism.inverse_kinematics(0.0, l)):
        return 0.0, l
    part = max(found.parts(most), key=lambda polygon: polygon.centroid.y)
    _, low, _, high = part.bounds
    on_axis = part.intersection(shapely.LineString([(0, low), (0, high)]))
    point = part.representative_point() if on_axis.is_empty else on_axis.interpolate(0.5, normalized=True)
    return float(point.x), float(point.y)


def _analyze_dual_triangle(
    designs: Mapping[str, DualTriangleDesign], out: Path, progress: Progress
) -> dict[str, Numbers]:
    arms = {name: DualTriangle(design) for name, design in designs.items()}
    for name, arm in arms.items():
        if not arm.design.is_symmetric or arm.design.springs != "bilateral":
            raise ValueError(f"design {name}: the figures are of symmetric segments with bilateral springs")
        if not arm.straight_critical_loads()[0] > 0:
            raise ValueError(f"design {name}: its straight arm is unstable; a longer free_length1 and 2 is needed")
    for name, arm in arms.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        b = float(arm.design.b1)
        compared = [(name, arm), *((other, arms[other]) for other in arms if other != name)]
        targets = [(5.5 * b, -b), (5 * b, 1.5 * b), (4.5 * b, 0.0), (4 * b, 2.5 * b)]
        drawings: dict[str, Callable[[], Figure]] = {
            "zhao_fig2_torque": partial(dual.torque_curves, arm),
            "zhao_fig3_control": partial(dual.control_and_sensitivity, compared),
            "zhao_fig5_redundancy": partial(dual.redundancy, arm, targets),
            "zhao_fig6_control_over_targets": partial(dual.control_over_targets, compared),
            "buckling": partial(dual.buckling, arm),
            "loaded_workspace": partial(dual.loaded_workspace, arm),
            "critical_load": partial(dual.critical_load_map, arm),
            "workspace": partial(dual.workspace, arm),
        }
        step = _Steps(name, len(drawings) + 1, progress)
        for stem, drawing in drawings.items():
            step(stem)
            _save(drawing(), folder / stem)
        step("page")
        dual_triangle_page(arm, folder / "browse.html", f"Workspace without a load: {name}")
        step.finish()
    return {name: dual.numbers(arm) for name, arm in arms.items()}


def _analyze_planar_four_bar(
    designs: Mapping[str, PlanarFourBarDesign], out: Path, progress: Progress
) -> dict[str, Numbers]:
    table: dict[str, Numbers] = {}
    for name, design in designs.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        arm, l = PlanarFourBar(design), float(design.length)
        progress(name, 0, 8, "workspaces")
        tips = {mode: output_workspace(arm, mode) for mode in MODES}
        drawings: dict[str, Callable[[], Figure]] = {
            "ji_fig2_actuator_workspace": partial(four_bar.actuator_workspaces, arm),
            "ji_fig3_output_workspace": partial(four_bar.output_workspaces, arm, tips),
            "singular_configurations": partial(four_bar.singular_postures, arm),
            "thrusts": partial(four_bar.thrust_map, arm),
            "energy_landscape": partial(four_bar.energy_landscape, arm, (1.4 * l, 1.2 * l)),
        }
        step = _Steps(name, len(drawings) + 3, progress)
        for stem, drawing in drawings.items():
            step(stem)
            _save(drawing(), folder / stem)
        step("regions")
        for mode in MODES:
            inputs = actuator_workspace(arm, mode).trace()
            _write_geojson(inputs.to_features(), folder / f"actuator_{mode}.geojson", coordinates="rho1, rho2 [m]")
            _write_geojson(tips[mode].to_features(), folder / f"output_{mode}.geojson", coordinates="x, y [m]")
        step("page")
        four_bar_page(arm, tips, folder / "browse.html", f"Output workspace: {name}")
        step("numbers")
        table[name] = four_bar.numbers(arm, tips)
        step.finish()
    return table


def _analyze_spatial_prism(
    designs: Mapping[str, SpatialPrismDesign], out: Path, progress: Progress
) -> dict[str, Numbers]:
    numbers: dict[str, Numbers] = {}
    for name, design in designs.items():
        prism, folder = SpatialPrism(design), out / name
        folder.mkdir(parents=True, exist_ok=True)
        drawings: dict[str, Callable[[], Figure]] = {
            f"jahromy_fig{number}_forces_{trajectory}": partial(spatial.forces_along, prism, trajectory)
            for number, trajectory in enumerate(TRAJECTORIES, 4)
        }
        drawings |= {
            "compliance": partial(spatial.compliance_maps, prism),
            "unloading_limits": partial(spatial.unloading_maps, prism),
            "unloading_directions": partial(spatial.polar_limits, prism),
            "pictures": partial(spatial.pictures, prism),
            "workspace": partial(spatial.workspace, prism),
        }
        step = _Steps(name, len(drawings) + 1, progress)
        for stem, drawing in drawings.items():
            step(stem)
            _save(drawing(), folder / stem)
        step("page")
        spatial_prism_page(prism, folder / "browse.html", f"Spatial prism: {name}")
        step.finish()
        numbers[name] = spatial.numbers(prism)
    return numbers


ANALYSES: dict[str, Analysis] = {
    "two-x": Analysis(
        "stable wrench-feasible set; without offsets also regions by inverse solutions, cusps, posture changes",
        {"muralidharan2022": lambda: MURALIDHARAN2022, "furet2018": lambda: FURET2018(2 / 3)},
        ("muralidharan2022", "furet2018,b=0.4", "furet2018,b=0.6666666666666666", "furet2018,b=0.9"),
        _analyze_two_x,
    ),
    "dual-triangle": Analysis(
        "torque, control, redundancy, buckling, what can be held under a load",
        {"zhao2021_caption": lambda: ZHAO2021_CAPTION, "zhao2021_text": lambda: ZHAO2021_TEXT},
        ("zhao2021_caption", "zhao2021_text"),
        _analyze_dual_triangle,
    ),
    "planar-four-bar": Analysis(
        "actuator and output workspace, singular configurations, thrusts, energy of the mirror images",
        {"ji2014": lambda: JI2014},
        ("ji2014",),
        _analyze_planar_four_bar,
    ),
    "spatial-prism": Analysis(
        "forces along the published trajectories, compliance, loads at which struts or cables go slack",
        {"jahromy": lambda: JAHROMY},
        ("jahromy",),
        _analyze_spatial_prism,
    ),
}
