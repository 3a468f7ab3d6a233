"""What every figure must be, read from the figure itself."""

import re

UNIT = re.compile(r"\[[^\]]+\]$")


def faults(figure) -> list[str]:
    """What is wrong with a figure: labels without units, legends on data."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    shown = [axes for axes in figure.axes if axes.axison]
    found = []
    for axes in shown:
        for name, shared in (("x", axes.get_shared_x_axes()), ("y", axes.get_shared_y_axes())):
            axis = getattr(axes, f"{name}axis")
            ticks = [tick for tick in axis.get_ticklabels() if tick.get_visible() and tick.get_text()]
            label = axis.get_label().get_text()
            numbers = [tick for tick in ticks if re.fullmatch(r"\W?[\d.$\\{}^\W]+|.*\\pi.*", tick.get_text())]
            if label and not UNIT.search(label.strip()) and label not in ("step", "steps"):
                found.append(f"{name} label {label!r} has no unit")
            row = [label] + [
                getattr(other, f"{name}axis").get_label().get_text() for other in shown if shared.joined(axes, other)
            ]
            if numbers and not any(row):
                found.append(f"{name} axis of {axes.get_title()!r} has numbers and no label")
    boxes = [axes.get_window_extent(renderer).padded(-2) for axes in shown]
    legends = [axes.get_legend() for axes in shown if axes.get_legend()] + list(figure.legends)
    for legend in legends:
        extent = legend.get_window_extent(renderer)
        if any(extent.overlaps(box) for box in boxes):
            found.append(f"the legend of {[text.get_text() for text in legend.get_texts()]} lies on axes")
        if extent.x0 < -2 or extent.y0 < -2 or extent.x1 > figure.bbox.x1 + 2 or extent.y1 > figure.bbox.y1 + 2:
            found.append(f"the legend of {[text.get_text() for text in legend.get_texts()]} is cut off")
    return found
