"""The drawings of docs/cell.md as SVG, made from the objects that they show; not part of the installed packages."""
