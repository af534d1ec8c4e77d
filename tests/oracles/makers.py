"""Arms as their makers describe them: the numbers of their URDF, and the text that they make of these."""

from math import pi

UR = {
    "ur3e": """
        0 0 0.15185  1.98  0 0 -0.02  0.0027657 0.0000096 -0.0000149 0.0021501 0.0001873 0.0025626
        0 0 0  3.4445  -0.11355 0 0.1157  0.0042623 -0.0000409 -0.0014960 0.0460284 -0.0000129 0.0448947
        -0.24355 0 0  1.437  -0.1632 0 0.0238  0.0010511 0.0 -0.0000331 0.0113396 0.0000022 0.0110895
        -0.2132 0 0.13105  0.871  0 -0.01 0  0.0008174 -0.0000005 0.0000021 0.0006844 0.0000617 0.0005497
        0 -0.08535 -1.750557762378351e-11  0.805  0 0.01 0  0.0006059 -0.0000006 -0.0000006 0.0005837 -0.0000271 0.0003831
        0 0.0921 -1.8890025766262e-11  0.261  0 0 -0.02  0.0001080 -0.0000001 -0.0000001 0.0001086 -0.0000002 0.0001371
    """,
    "ur16e": """
        0 0 0.1807  7.369  0 -0.03 -0.016  0.03351 2e-05 -1e-05 0.03374 0.00374 0.021
        0 0 0  10.45  -0.1764 0 0.16  0.02796 -0.0001 -0.0072 0.47558 3e-05 0.47635
        -0.4784 0 0  4.321  -0.166 0 0.065  0.01091 6e-05 0.01012 0.1206 1e-05 0.11714
        -0.36 0 0.17415  2.18  0 -0.011 -0.009  0.00609 -1e-05 0 0.00245 0.00083 0.00579
        0 -0.11985 -2.458164590756244e-11  2.033  0 0.012 -0.018  0.00389 -1e-05 0 0.00219 -0.00045 0.00363
        0 0.11655 -2.390480459346185e-11  0.907  0 0 -0.044  0.00117 0 0 0.00118 0 0.00084
    """,
    "ur20": """
        0 0 0.2363  16.343  0 -0.0062 -0.061  0.08866 -0.00011 -0.00011 0.07632 0.0072 0.08418
        0 0 0  29.632  -0.3394 0 0.2098  0.1467 0.00019 -0.05163 4.6659 4e-05 4.6348
        -0.862 0 0  7.879  -0.4053 0 0.0604  0.02612 -5e-05 -0.02898 0.75763 -1e-05 0.75327
        -0.7287 0 0.201  3.054  0 -0.0393 -0.0026  0.00555 -1e-05 -2e-05 0.00537 0.00036 0.00402
        0 -0.1593 -3.267297616249225e-11  3.126  0 0.0379 -0.0024  0.00586 -1e-05 -2e-05 0.00578 -0.00037 0.00427
        0 0.1543 -3.1647459019915597e-11  0.926  0 0 -0.0293  0.00092 0 0 0.00091 0 0.00117
    """,
}
"""Universal_Robots_ROS2_Description, default_kinematics.yaml and physical_parameters.yaml (BSD 3-Clause): for each joint its
place, then the mass, the centre of mass and the inertia xx, xy, xz, yy, yz, zz of its link."""
UR_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
UR_RPY = ("0 0 0", "1.570796327 0 0", "0 0 0", "0 0 0", "1.570796327 0 0", f"1.570796326589793 {pi!r} {pi!r}")
"""How the joints are turned, in every default_kinematics.yaml."""
UR_INERTIA_ROLL = ("1.570796326794897", "0", "0", "1.570796326794897", "-1.570796326794897", "0")
"""How the inertias are turned, in every physical_parameters.yaml."""
FR3 = """
    0 0 0.333  0  2.9274653454  0.0000004128 -0.0181251324 -0.0386035970
        0.023927316485107913 1.3317903455714081e-05 -0.00011404774918616684
        0.0224821613275756 -0.0019950320628240115 0.006350098258530016
        87.0 -2.750100 2.75010 2.62  0.30 6.0
    0 0 0  -1.570796326794897  2.9355370338  0.0031828864 -0.0743221644 0.0088146084
        0.041938946257609425 0.00020257331521090626 0.004077784227179924
        0.02514514885014724 -0.0042252158006570156 0.06170214472888839
        87.0 -1.791800 1.79180 2.62  0.20 2.585
    0 -0.316 0  1.570796326794897  2.2449013699  0.0407015686 -0.0048200565 -0.0289730823
        0.02410142547240885 0.002404694559042109 -0.002856269270114313
        0.01974053266708178 -0.002104212683891874 0.019044494482244823
        87.0 -2.906500 2.90650 2.62  0.20 3.50
    0.0825 0 0  1.570796326794897  2.6155955791  -0.0459100965 0.0630492960 -0.0085187868
        0.03452998321913202 0.01322552265982813 0.01015142998484113
        0.028881621933049058 -0.0009762833870704552 0.04125471171146641
        87.0 -3.048100 -0.1458 2.62  0.30 4.00
    -0.0825 0.384 0  -1.570796326794897  2.3271207594  -0.0016039605 0.0292536262 -0.0972965990
        0.051610278463662895 -0.005715173387783472 -0.0035673167625872135
        0.04787729713371481 0.010673985108535986 0.016423625579357254
        12.0 -2.810100 2.81010 5.26  0.35 17.0
    0 0 0  1.570796326794897  1.8170376524  0.0597131221 -0.0410294666 -0.0101692726
        0.005412333594383447 0.006193456360285834 0.0014219289306117652
        0.014058329545509979 -0.0013140753741120031 0.016080817924212554
        12.0 0.54092 4.52050 4.18  0.35 5.5
    0.088 0 0  1.570796326794897  0.6271432862  0.0045225817 0.0086261921 -0.0161633251
        0.00021092389150104718 -2.433299114461931e-05 4.564480393778983e-05
        0.00017718568002411474 8.744070223226438e-05 5.993190599659971e-05
        12.0 -3.019600 3.01960 5.26  0.35 17.0
"""
"""libfranka, test/fr3.urdf (Apache-2.0): for each joint its place, its roll, and mass, centre of mass and inertia of its link;
effort, lower, upper and velocity of <limit>; offset and deceleration of <position_based_velocity_limits>."""


def ur_urdf(name: str) -> str:
    """Universal_Robots_ROS2_Description, urdf/ur_macro.xacro, without shapes and limits: from base_link to tool0."""
    text = '<link name="base_link"/><link name="link0"/>' + _fixed("base_link", "link0", f"0 0 {pi!r}")
    for i, row in enumerate(UR[name].strip().splitlines()):
        words = row.split()
        text += _link(i + 1, words[3:], f"{UR_INERTIA_ROLL[i]} 0 0")
        inside = '<limit lower="-7" upper="7" effort="1" velocity="1"/>'
        text += _joint(f"{UR_NAMES[i]}_joint", i, words[:3], UR_RPY[i], inside)
    text += '<link name="flange"/>' + _fixed("link6", "flange", f"0 {-pi / 2!r} {-pi / 2!r}")
    return f'<robot name="{name}">{text}<link name="tool0"/>{_fixed("flange", "tool0", f"{pi / 2!r} 0 {pi / 2!r}")}</robot>'


def fr3_urdf() -> str:
    """libfranka's model of the FR3, without shapes, friction and links that only mark a place: from link0 to link8."""
    words, text = FR3.split(), '<link name="link0"/>'
    for i in range(7):
        row = words[20 * i : 20 * i + 20]
        effort, lower, upper, velocity, offset, deceleration = row[14:]
        inside = f'<limit effort="{effort}" lower="{lower}" upper="{upper}" velocity="{velocity}"/>'
        inside += f'<position_based_velocity_limits velocity_offset="{offset}" deceleration_limit="{deceleration}"/>'
        text += _link(i + 1, row[4:14], "0 0 0") + _joint(f"joint{i + 1}", i, row[:3], f"{row[3]} 0 0", inside)
    return f'<robot name="fr3">{text}<link name="link8"/>{_fixed("link7", "link8", "0 0 0", "0 0 0.107")}</robot>'


def _link(number: int, words: list[str], rpy: str) -> str:
    """A link with the mass, centre of mass and inertia in words."""
    parts = " ".join(f'{k}="{x}"' for k, x in zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), words[4:], strict=True))
    body = f'<origin xyz="{" ".join(words[1:4])}" rpy="{rpy}"/><mass value="{words[0]}"/><inertia {parts}/>'
    return f'<link name="link{number}"><inertial>{body}</inertial></link>'


def _joint(name: str, i: int, xyz: list[str], rpy: str, inside: str) -> str:
    """The joint from link i to the next."""
    ends = f'<parent link="link{i}"/><child link="link{i + 1}"/><origin xyz="{" ".join(xyz)}" rpy="{rpy}"/>'
    return f'<joint name="{name}" type="revolute">{ends}<axis xyz="0 0 1"/>{inside}</joint>'


def _fixed(parent: str, child: str, rpy: str, xyz: str = "0 0 0") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<joint name="to_{child}" type="fixed">{ends}</joint>'
