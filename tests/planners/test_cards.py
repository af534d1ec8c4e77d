"""What a notebook shows of results: short texts, cards whose numbers are those of the certificate, figures, and pages."""

import html.parser
import re
import webbrowser
from dataclasses import replace

import numpy as np
import pytest

import optik
import planners
from optik.card import MOST_POINTS, Bar, Card, Plot
from optik.errors import InvalidInput
from optik.view import Page
from optik.view.page import MOST_PAGE
from planners.certificate.certificate import find_enforced
from planners.following.follow import _format
from tests.planners.cases import START, paper6r
from tests.planners.motions import planned

LONGEST = 2000
"""Characters of a text in a cell."""


class Reader(html.parser.HTMLParser):
    """The tags, points and texts of HTML."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.lines: list[np.ndarray] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "polyline":
            points = dict(attrs)["points"] or ""
            self.lines.append(np.array([[float(x) for x in point.split(",")] for point in points.split()]))

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


def failed() -> planners.Plan:
    robot, away = paper6r(), paper6r().fk(START)
    away[0, 3] += 9.0
    plan = planners.plan(robot, away, START)
    assert not plan
    return plan


def results() -> dict[str, object]:
    plan, robot = planned(), paper6r()
    batch = optik.solve_ik_batch(robot, np.repeat(robot.fk(START)[None], 50, axis=0), START)
    return {
        "robot": robot, "plan": plan, "failed": failed(), "certificate": plan.certificate, "trajectory": plan.trajectory,
        "ik": optik.solve_ik(robot, robot.fk(START), START + 0.1, trace=True), "batch": batch,
        "scene": optik.Scene(planes=[((0.0, 0.0, -0.1), (0.0, 0.0, 1.0))]), "path": plan.path, "joints": plan.joint_path,
    }  # fmt: skip


@pytest.mark.parametrize("name", results().keys())
def test_texts_and_cards_are_short_and_run_nothing(name: str) -> None:
    shown = results()[name]
    assert 0 < len(repr(shown)) <= LONGEST and " object at 0x" not in repr(shown)
    if name in ("batch", "path", "joints"):
        return
    found = Reader(shown._repr_html_())  # type: ignore[attr-defined]
    assert not {"script", "iframe", "link", "img"} & set(found.tags)
    assert len("".join(found.texts)) <= LONGEST


def test_texts_of_a_user_are_escaped() -> None:
    name = "<script>alert(1)</script>"
    scene = optik.Scene(planes=[((0.0, 0.0, -0.1), (0.0, 0.0, 1.0))], names=[name])
    assert "script" not in Reader(scene._repr_html_()).tags and name in Reader(scene._repr_html_()).texts
    assert Reader(Card(title=name, facts=[(name, name)], bars=[Bar(name, 0.5, name)]).to_html()).texts.count(name) == 5


def test_the_bars_of_a_plan_are_the_ratios_of_its_certificate() -> None:
    plan = planned()
    texts = Reader(plan._repr_html_()).texts
    for limit in ("velocity", "acceleration", "jerk"):
        ratio, joint, t = plan.certificate.worst(limit)
        at = texts.index(limit)
        assert [text for text in texts[at:] if text][1:3] == [f"{ratio:.3g}", f"{joint} at {t:.3g} s"]
    assert any(text.startswith("✓") for text in texts) and "✗" in "".join(Reader(failed()._repr_html_()).texts)


def test_the_curves_of_a_card_are_those_of_the_motion() -> None:
    plan = planned()
    curves, n = Reader(plan._repr_html_()).lines, plan.robot.n
    t = np.linspace(0.0, plan.trajectory.duration, MOST_POINTS)
    assert len(curves) == 4 * n
    for joint in range(n):
        drawn, values = -curves[n + joint][:, 1], plan.trajectory(t, 1)[:, joint]
        slope, offset = np.polyfit(values, drawn, 1)
        assert np.abs(slope * values + offset - drawn).max() <= 0.06, "heights are rounded to a tenth of a pixel"


@pytest.mark.parametrize("x", [np.zeros(1), np.linspace(0.0, 1.0, 1000)], ids=["one instant", "many"])
def test_a_plot_has_few_points_within_its_frame(x: np.ndarray) -> None:
    plot = Plot("p", x, np.stack([np.sin(x), np.full_like(x, 3.0)], axis=1), (-1.0, 1.0))
    for _, points in plot.lines:
        xy = np.array([[float(v) for v in point.split(",")] for point in points.split()])
        assert len(xy) <= MOST_POINTS and (xy >= 0.0).all() and (xy <= [230.0, 96.0]).all()


def test_a_figure_has_curves_limits_and_the_active_constraint() -> None:
    plan = planned()
    figure, n = plan.plot(), plan.robot.n
    curves = [trace for trace in figure.data if trace.mode is None]
    orders = [0, 1, 2, 3]
    for order in orders:
        for joint in range(n):
            trace = curves[order * n + joint]
            np.testing.assert_allclose(
                trace.y, plan.trajectory(np.asarray(trace.x), order)[:, joint], rtol=0, atol=1e-12
            )
            if order:
                name = ("velocity", "acceleration", "jerk")[order - 1]
                bound = np.broadcast_to(getattr(plan.limits, name), n)[joint]
                levels = {
                    t.y[0] for t in figure.data if t.mode == "lines" and t.yaxis == trace.yaxis and t.name == trace.name
                }
                assert levels == {-bound, bound}
    strips = [trace for trace in figure.data if trace.mode == "lines+text"]
    assert [strips[0].x[0], strips[-1].x[-1]] == [0.0, plan.trajectory.duration]
    active = find_enforced(plan.certificate)
    for strip in strips:
        k = int(np.searchsorted(active.t, strip.x[1], side="right")) - 1
        assert strip.hovertemplate.startswith(f"{active.limit[k]} of {active.joint[k]}: ")
    assert max(map(len, figure.layout.title.text.split("<br>"))) <= 50, "a title fits a page of 400 pixels"
    low, high = figure.layout.yaxis.range
    assert low < plan.trajectory(0.0).min() and high - low < 1.2 * np.ptp(
        plan.trajectory(np.linspace(0, plan.duration))
    )


def test_a_failed_plan_is_plotted_and_shown_up_to_its_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda url: True)
    plan = failed()
    assert plan.prefix is not None and plan.failure is not None
    figure = plan.plot()
    assert "plan FAILED" in figure.layout.title.text
    ends = [trace.y[-1] for trace in figure.data if trace.mode is None]
    np.testing.assert_allclose(ends, plan.prefix(plan.failure.s), atol=1e-9)
    page = plan.show()
    assert "plan FAILED" in page.html and plan.failure.reason.split(";")[0][:100] in page.html
    robot = paper6r()
    nowhere = replace(plan, prefix=None, path=planners.Line(robot.fk(START), robot.fk(START) + 9.0 * np.eye(4, k=3)))
    assert "none is known on the path" in nowhere.show().html and "plan FAILED" in nowhere.plot().layout.title.text


def test_a_page_opens_in_the_browser_or_in_a_cell(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    scene = optik.Scene(boxes=[(optik.se3.pose(np.eye(3), [0.5, 0.0, 0.2]), [0.1, 0.1, 0.1])])
    for page in (planned().show(), paper6r().show(START, scene=scene), optik.load("panda").show()):
        assert isinstance(page, Page) and len(page.html) <= 1e6 < MOST_PAGE
        assert re.match(r"file://.*/view.html", opened[-1])
        cell = Reader(page._repr_html_())
        assert cell.tags == ["iframe"] and "<script>" not in page._repr_html_()
        page.save(tmp_path / "page.html")
        assert (tmp_path / "page.html").read_text("utf-8") == page.html
    with pytest.raises(InvalidInput):
        paper6r().show(np.full(6, np.nan))


# ---------------------------------------------------------------- methods of a notebook
class Half(optik.ik.IKSolver):
    """Halves the tolerance of lm: a class without a name of its own."""

    def attempt(self, target, start, trace, time_limit):
        found = optik.solve_ik(self.robot, target, start)
        return optik.ik.base.Attempt(found.q, found.status, 1, None, "half")


class Slow(planners.timing.TimeLaw):
    """The law of the paper at half its speed."""

    enforced = ()

    def _time(self, joint_path, limits):
        return planners.make_law("quintic")._time(joint_path, limits).stretched(2.0)


def test_a_class_or_an_object_of_the_user_works_as_a_name_does() -> None:
    robot, target = paper6r(), paper6r().fk(START)
    for solver in (Half, Half(robot), Half(robot, max_restarts=2)):
        assert optik.solve_ik(robot, target, START + 0.1, solver).message == "half"
        plan = planners.plan(robot, planned().path, START, solver=solver, timing=Slow)
        assert (plan.solver, plan.law) == ("half", "slow")
    assert optik.solve_ik(robot, target, START + 0.1, Half(robot), max_restarts=1).message == "half"
    assert planners.make_law(Slow()).name == "slow"
    for wrong in (3, int, Slow, Half(optik.load("ur5e"))):
        with pytest.raises(InvalidInput):
            optik.solve_ik(robot, target, START, wrong)  # type: ignore[arg-type]
    for wrong in (3, int, Half):
        with pytest.raises(InvalidInput):
            planners.make_law(wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="a law that is built"):
        planners.make_law(Slow(), speed=1.0)


def test_rounding_errors_are_no_numbers_of_a_text() -> None:
    robot = paper6r()
    result = optik.solve_ik(robot, robot.fk(START), START + 0.1)
    result = result._replace(q=START * [1, 1, 1, 1e-33, -1e-17, 1], position_error=3e-17, rotation_error=1.2e-16)
    for text in (str(result), result._repr_html_(), _format(robot, result.q)):
        assert not re.search(r"e-\d\d|-0[,\s]", text), text
    assert "position error 0 mm, rotation error 0 rad" in str(result)
    assert "position error 2e-06 mm" in str(result._replace(position_error=2e-9))
