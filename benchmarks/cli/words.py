"""Messages of the library in the words of the command line."""

from __future__ import annotations

import re

import numpy as np

TRANSLATED = "allow|branch|columns|gravity|ignore|joint_names|rotation_speed|start|timing|tool_speed|unit|unwrap"
"""Arguments of the library, in messages, that are options of the same name."""
NUMBER = r"-?\d[\d.]*(?:e[-+]?\d+)?"
"""Regular expression of a number in a message."""


def translate(words: str) -> str:
    """Return a message of the library with degrees, millimetres and options in place of radians and Python arguments."""

    def scale(match: re.Match[str]) -> str:
        factor, unit = (180.0 / np.pi, "°") if match["unit"] == "rad" else (1e3, " mm")
        values = re.sub(NUMBER, lambda number: f"{float(number[0]) * factor:.4g}", match["values"])
        return values + unit

    words = re.sub(rf"(?P<values>\[{NUMBER}(?:, {NUMBER})+\]) (?P<unit>rad|m)\b", scale, words)
    words = re.sub(rf"(?P<values>{NUMBER}) (?P<unit>rad)\b(?!/)", scale, words)
    words = name_robot_options(name_options(words, TRANSLATED))
    for python, typed in (("q_start", "--start-deg"), ("optik.solve_ik with closest=True", "optik ik --closest"),
                          ("time_limit", "--time-limit"), ("with_limits sets them", "only <limit> is read"),
                          ("with_limits(torque=None)", "--torque none"), ("with_limits(velocity=)", "--velocity")):  # fmt: skip
        words = words.replace(python, typed)
    return words.replace(" (max_restarts)", "")  # no option of `optik plan`


def name_options(words: str, names: str) -> str:
    """Return a message with options in place of Python arguments, such as --tip tool0 for tip='tool0'."""

    def join(match: re.Match[str]) -> str:
        values = [quoted or plain for quoted, plain in re.findall(r"'([^']+)'|([-+.\w]+)", match[2])]
        value = "none" if match[2] == "()" else ",".join(values)
        return f"--{match[1].replace('_', '-')}{'-deg' * (match[1] == 'start')} {value}".rstrip()

    return re.sub(rf"(?<![\w#&])({names})=(?!LINK|X,Y,Z)(\([^)]*\)|'[^']*'|[^ ,;)]*)", join, words)


def name_robot_options(words: str) -> str:
    """Return a message about the file of a robot with options in place of Python arguments."""
    held = re.compile(r"values=\{([^}]*)\}")
    words = held.sub(lambda match: re.sub(r"'([^']+)': ", r"--hold \1=", match[1]).replace(", --", " --"), words)
    for python, typed in (("package_dirs=, on the command line --package-dir", "--package-dir"),
                          ("srdf=, or shapes.with_apart", "--srdf FILE"),
                          ("a file, or shapes.with_part", "files in STL or OBJ")):  # fmt: skip
        words = words.replace(python, typed)
    return name_options(words, "tip|base|gravity|without_shape")
