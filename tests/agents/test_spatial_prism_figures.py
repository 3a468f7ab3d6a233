"""What the figures of the spatial prism show; `tensegrity analyze spatial-prism` draws them all (minutes)."""

import numpy as np
import pytest

from tensegrity_agents.analysis import ANALYSES
from tensegrity_agents.analysis.spatial_prism import figures as spatial
from tensegrity_envs.mechanics import SpatialPrism
from tensegrity_envs.mechanics.spatial_prism import trajectory31

PRISM = SpatialPrism()


def test_the_analysis_is_in_the_table():
    assert ANALYSES["spatial-prism"].default == ("jahromy",)


def test_forces_are_those_of_the_lengths():
    (axes,) = spatial.forces_along(PRISM, "eq31").axes
    t = axes.lines[0].get_xdata()
    for line, length in zip(axes.lines[:3], PRISM.unloaded_lengths(trajectory31(t)), strict=True):
        np.testing.assert_allclose(line.get_ydata(), 100 * length)
    np.testing.assert_allclose(axes.lines[3].get_ydata(), 50)


def test_compliance_on_the_axis():
    panels = spatial.compliance_maps(PRISM).axes
    assert panels[1].get_title() == "z = 0.4 m"
    values = spatial.compliance(PRISM, np.zeros(1), np.zeros(1), 0.4)
    for value, expected, panel in zip(values, (0.532, 0.301), (panels[1], panels[5]), strict=True):
        assert value[0] == pytest.approx(expected, abs=5e-4)
        drawn = panel.collections[0]
        bands = [k for k, path in enumerate(drawn.get_paths()) if path.contains_point((1e-4, 1e-4))]
        assert any(drawn.levels[k] <= expected <= drawn.levels[k + 1] for k in bands)


def test_pictures_show_every_member():
    panels = spatial.pictures(PRISM).axes
    assert len(panels) == 4
    assert all(len(axes.lines) >= 9 for axes in panels)
