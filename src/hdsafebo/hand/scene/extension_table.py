"""What the `extended` hand adds to MyoHand: 12 muscles and 5 joints, each with its published source.

Points are given in the zero pose of MyoHand's own frame, in metres: x distal, y radial, z dorsal.

How the numbers came about:

* Landmarks of origin and insertion follow Standring (ed.), Gray's Anatomy, 42nd ed., 2021, chapters 49
  and 50. The coordinates are ours: each landmark was placed on the bones of MyoHand, since the published
  hand models use other bones. The moment arms that result are tested for sign and range.
* Maximal forces are the physiological cross-sectional areas of Jacobson et al., "Architectural design of
  the human intrinsic hand muscles", J Hand Surg 17A:804-809, 1992, times 45 N/cm2, the specific tension
  of forearm and hand muscles in Holzbaur et al., Ann Biomed Eng 33:829-840, 2005, on whose model MyoHand
  rests. Jacobson et al. give one area for each of FPB and ADP; that their two heads share it equally is
  an assumption.
* A second head takes its share from the head that MyoHand has, so the sum stays that of MyoHand.
* MyoHand's OP (180 N) stands for the whole thenar group: 45 N/cm2 times the areas of OP, APB, FPB and ADP
  (4.3 cm2) is 194 N. With the other three present, OP gets the force of its own 1.02 cm2.
"""

from __future__ import annotations

from dataclasses import dataclass

SPECIFIC_TENSION = 45.0
"""N/cm2, Holzbaur et al. 2005."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Point:
    """A new via point: body, position in the zero pose (m) and the anatomical landmark."""

    body: str
    position: Vector
    landmark: str


@dataclass(frozen=True)
class Via:
    """A via point that MyoHand already has."""

    site: str


@dataclass(frozen=True)
class AddedMuscle:
    """A muscle-tendon unit of the extension.

    Attributes:
        name: short name; the model appends `_r`.
        path: from origin to insertion; via points stand in for wrapping surfaces.
        area: physiological cross-sectional area, cm2; None for a second head of `parent`.
        parent: the MyoHand muscle that gives `share` of its force to this head.
        share: fraction of the parent's force.
        source: of the force, and of the share.
    """

    name: str
    path: tuple[Point | Via, ...]
    source: str
    area: float | None = None
    parent: str | None = None
    share: float = 0.0


@dataclass(frozen=True)
class AddedJoint:
    """A hinge of the extension.

    Attributes:
        name: of the joint.
        body: the body that it moves relative to its parent.
        anchor: a point of the axis in the zero pose, m; None for the origin of `body`.
        axis: direction in the zero pose; the positive sense is named in `positive`.
        limits: range, rad.
        positive: the movement of positive angles.
        source: of axis and range.
    """

    name: str
    body: str
    anchor: Vector | None
    axis: Vector
    limits: tuple[float, float]
    positive: str
    source: str


_JACOBSON = "area: Jacobson et al. 1992"
_EL_SHENNAWY = "El-shennawy et al., J Hand Surg 26A:1030-1035, 2001"

OPPONENS_AREA = 1.02
"""cm2, OP itself (Jacobson et al. 1992)."""

MUSCLES: tuple[AddedMuscle, ...] = (
    AddedMuscle(
        "APB",
        (
            Point("scaphoid_r", (0.533, 0.022, 0.158), "tubercle of the scaphoid"),
            Point("firstmc_r", (0.558, 0.0455, 0.146), "over the radial side of OP"),
            Point(
                "proximal_thumb_r", (0.581, 0.0600, 0.1445), "radial side of the base of the proximal phalanx"
            ),
        ),
        _JACOBSON,
        area=0.68,
    ),
    AddedMuscle(
        "FPBs",
        (
            Point("trapezium_r", (0.541, 0.020, 0.155), "flexor retinaculum and tubercle of the trapezium"),
            Point("firstmc_r", (0.563, 0.040, 0.142), "over the palmar side of OP"),
            Point(
                "proximal_thumb_r",
                (0.581, 0.0560, 0.1425),
                "radial sesamoid and base of the proximal phalanx",
            ),
        ),
        _JACOBSON + "; half of FPB (assumption)",
        area=0.33,
    ),
    AddedMuscle(
        "FPBd",
        (
            Point("capitate_r", (0.546, 0.012, 0.162), "palmar ligaments of trapezoid and capitate"),
            Point("firstmc_r", (0.566, 0.034, 0.146), "dorsal to the tendon of FPL"),
            Point("proximal_thumb_r", (0.581, 0.0500, 0.1425), "base of the proximal phalanx"),
        ),
        _JACOBSON + "; half of FPB (assumption)",
        area=0.33,
    ),
    AddedMuscle(
        "ADPo",
        (
            Point(
                "capitate_r", (0.549, 0.010, 0.165), "capitate and bases of the second and third metacarpals"
            ),
            Point(
                "proximal_thumb_r", (0.582, 0.0450, 0.147), "ulnar sesamoid and base of the proximal phalanx"
            ),
        ),
        _JACOBSON + "; half of ADP (assumption)",
        area=0.97,
    ),
    AddedMuscle(
        "ADPt",
        (
            Point("thirdmc_r", (0.575, 0.0095, 0.169), "palmar border of the third metacarpal"),
            Point(
                "proximal_thumb_r", (0.583, 0.0440, 0.148), "ulnar side of the base of the proximal phalanx"
            ),
        ),
        _JACOBSON + "; half of ADP (assumption)",
        area=0.97,
    ),
    AddedMuscle(
        "ADM",
        (
            Point("pisiform_r", (0.534, -0.009, 0.156), "pisiform and tendon of FCU"),
            Point("fifthmc_r", (0.570, -0.021, 0.156), "ulnar border of the fifth metacarpal"),
            Point("5proxph_r", (0.600, -0.0215, 0.158), "ulnar side of the base of the proximal phalanx"),
        ),
        _JACOBSON,
        area=0.89,
    ),
    AddedMuscle(
        "FDMB",
        (
            Point("hamate_r", (0.545, -0.002, 0.157), "hook of the hamate and flexor retinaculum"),
            Point("fifthmc_r", (0.572, -0.015, 0.152), "palmar side of the fifth metacarpal"),
            Point(
                "5proxph_r", (0.600, -0.0160, 0.1535), "palmar-ulnar side of the base of the proximal phalanx"
            ),
        ),
        _JACOBSON,
        area=0.54,
    ),
    AddedMuscle(
        "ODM",
        (
            Point("hamate_r", (0.545, -0.001, 0.158), "hook of the hamate and flexor retinaculum"),
            Point("fifthmc_r", (0.577, -0.0205, 0.160), "ulnar margin of the fifth metacarpal"),
        ),
        _JACOBSON,
        area=1.10,
    ),
    AddedMuscle(
        "DI1b",
        (
            Point(
                "firstmc_r", (0.560, 0.0370, 0.157), "ulnar border of the first metacarpal (superficial head)"
            ),
            Point("2proxph_r", (0.608, 0.0350, 0.180), "radial side of the base of the proximal phalanx"),
        ),
        "two heads of equal force (assumption) of MyoHand's RI2",
        parent="RI2",
        share=0.5,
    ),
    AddedMuscle(
        "PTu",
        (
            Point("ulna_r", (0.283, -0.004, 0.120), "coronoid process of the ulna"),
            Via("PT-P3_r"),
            Via("PT-P4_r"),
            Via("PT-P5_r"),
        ),
        "the ulnar head is the smaller one (Gray's Anatomy); a quarter of the force is an assumption",
        parent="PT",
        share=0.25,
    ),
    AddedMuscle(
        "FCUu",
        (
            Point("ulna_r", (0.300, -0.012, 0.118), "olecranon and posterior border of the ulna"),
            Via("FCU-P2_r"),
            Via("FCU-P3_r"),
            Via("FCU-P4_r"),
            Via("FCU-P5_r"),
        ),
        "two heads of equal force (assumption) of MyoHand's FCU",
        parent="FCU",
        share=0.5,
    ),
    AddedMuscle(
        "PQd",
        (
            Point("radius_r", (0.4885, 0.0205, 0.1675), "distal radius, distal to the superficial head"),
            Point("ulna_r", (0.4666, -0.0097, 0.1605), "ulna, proximal to the superficial head"),
        ),
        "deep head, oblique, 1.64 of 2.59 cm2: Johnson & Shrewsbury, J Hand Surg 1:205-209, 1976",
        parent="PQ",
        share=1.64 / 2.59,
    ),
)

JOINTS: tuple[AddedJoint, ...] = (
    AddedJoint(
        "cmc4_flexion_r",
        "fourthmc_r",
        (0.548, 0.000, 0.172),
        (0.0, 1.0, 0.0),
        (0.0, 0.35),
        "flexion",
        f"20 deg: {_EL_SHENNAWY}",
    ),
    AddedJoint(
        "cmc5_flexion_r",
        "fifthmc_r",
        (0.5444, -0.0078, 0.167),
        (0.0, 1.0, 0.0),
        (0.0, 0.47),
        "flexion",
        f"27 deg: {_EL_SHENNAWY}",
    ),
    AddedJoint(
        "cmc5_rotation_r",
        "fifthmc_r",
        (0.5444, -0.0078, 0.167),
        (1.0, 0.0, 0.0),
        (-0.08, 0.30),
        "palm turns towards the thumb (opposition)",
        f"22 deg: {_EL_SHENNAWY}; its division about the zero pose is an assumption",
    ),
    AddedJoint(
        "mp_abduction_r",
        "proximal_thumb_r",
        None,
        (-0.4126, 0.8735, 0.2596),
        (-0.17, 0.35),
        "abduction (radial)",
        "axis, perpendicular to flexion: Hollister et al., Clin Orthop 320:188-193, 1995; range: assumed",
    ),
    AddedJoint(
        "cmc_rotation_r",
        "firstmc_r",
        None,
        (0.811, 0.491, -0.319),
        (-0.15, 0.15),
        "supination",
        "17 deg about the long axis: Cooney et al., J Bone Joint Surg 63A:1371-1381, 1981",
    ),
)

REATTACHED: dict[str, str] = {
    "FDS5-P4_r": "fifthmc_r",
    "FDP5-P4_r": "fifthmc_r",
    "RI5-P1_r": "fifthmc_r",
    "LU_RB5-P1_r": "fifthmc_r",
    "UI_UB5-P1_r": "fifthmc_r",
    "FDS4-P4_r": "fourthmc_r",
    "FDP4-P4_r": "fourthmc_r",
    "RI4-P1_r": "fourthmc_r",
    "LU_RB4-P1_r": "fourthmc_r",
    "UI_UB4-P1_r": "fourthmc_r",
}
"""Via points of the ring and little finger that MyoHand puts on a neighbouring metacarpal.

With rigid metacarpals the bone makes no difference. With joints between them it does: the tendons would
cross joints that they do not cross in the hand. Each point keeps its place in the zero pose and moves with
the metacarpal of its own finger.
"""
