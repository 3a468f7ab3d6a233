"""The analysis of the 2-X manipulator."""

import csv
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from matplotlib.figure import Figure

from tensegrity_agents.analysis.base import Numbers, Progress, Steps, save_titled, write_geojson
from tensegrity_agents.analysis.two_x import accessibility_figures, stable_set_figures
from tensegrity_agents.analysis.two_x.page import write_page
from tensegrity_envs.geometry import accessibility, workspace
from tensegrity_envs.geometry.overlay import closed
from tensegrity_envs.mechanics.two_x import TwoX, TwoXDesign


def analyze(designs: Mapping[str, TwoXDesign], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Write figures, regions and a page for each design, by the name of its folder; their numbers."""
    numbers: dict[str, Numbers] = {}
    plain: dict[str, accessibility.Accessibility] = {}
    for name, design in designs.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        mechanism = TwoX(design)
        loaded = any((design.k1, design.k2, design.payload, design.bar_density))  # else purely kinematic
        bare = not design.a or not loaded
        step = Steps(name, 6 * loaded + 5 * bare, progress)
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
        save_titled(accessibility_figures.workspace_boundaries(titles), out / "furet_fig3_boundaries")
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
        "muralidharan_fig3_boundary_points": stable_set_figures.boundary_scan(mechanism, intervals, 0.0, cloud),
        "muralidharan_fig4_swfj_swfw": stable_set_figures.stable_sets(mechanism, cloud, traced, found),
        "active_conditions": stable_set_figures.active_conditions(mechanism, traced, found),
    }
    for stem, figure in figures.items():
        save_titled(figure, folder / stem)
    step("regions")
    write_geojson(traced.to_features(), folder / "swfj.geojson", coordinates="alpha_1, alpha_2 [rad]")
    write_geojson(found.to_features(), folder / "swfw.geojson", coordinates="x, y [m]")
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
    write_geojson(found.to_features(), folder / "accessibility.geojson", coordinates="x, y [m]")
    step("inverse solutions")
    target = _showpiece(found)
    solutions = mechanism.inverse_kinematics(*target)
    where = f" with the tip at ({target[0]:.4g}, {target[1]:.4g}) m"
    save_titled(
        accessibility_figures.inverse_solutions(mechanism, solutions, target),
        folder / "furet_fig4_inverse_solutions",
        where,
    )
    step("figures")
    save_titled(accessibility_figures.regions_by_type(found), folder / "furet_fig6_regions_by_type")
    step("joint limits")
    narrow = min(float(mechanism.design.joint_limit), 2 * math.pi / 3)  # theta within pi / 3, as in the paper
    limited = accessibility.accessibility(TwoX(replace(mechanism.design, joint_limit=narrow)))
    save_titled(accessibility_figures.joint_limited(limited), folder / "furet_fig7_joint_limits")
    write_geojson(limited.to_features(), folder / "joint_limits.geojson", coordinates="x, y [m]")
    step("posture change")
    if not mechanism.design.a:
        for pair in accessibility.posture_pairs(mechanism, *target):
            try:
                path = accessibility.posture_change(mechanism, *pair)
            except ValueError:
                continue  # within joint limits two solutions of one sign may be in different aspects
            figure = accessibility_figures.posture_change(found, path, accessibility.aspects(mechanism), pair[1])
            save_titled(figure, folder / "posture_change")
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
