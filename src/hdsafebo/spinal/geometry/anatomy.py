"""The cord from T12 to S2, its coverings, the paddle, the muscles' districts: every number and its source.

Axes, in mm: x to the right, y dorsal, z caudal; z = 0 is the rostral end of the T12 segment and x = y = 0
the centre of the cord. Each number stands beside its source, or beside ASSUMPTION where none was found
that supports it to the digit.

Sources
    Capogrosso et al. 2013, J Neurosci 33:19326, table 1 (after Ladenbauer et al. 2010, IEEE TNSRE 18:637).
    Frostell et al. 2016, Front Neurol 7:238 (pooled segmental diameters of the cord).
    Holsheimer et al. 1994, AJNR 15:951 (cord, sac and dorsal cerebrospinal fluid in MR images).
    Hong et al. 2011, Spine J 11:1121 (thickness of the dural sac).
    Kameyama et al. 1996, Spine 21:1285 (cross sections of the cord, segment by segment).
    Khadka et al. 2025, J Neural Eng 22(3) (conductivities across published models of stimulation).
    Phillips & Park 1991, Muscle Nerve 14:1213 (root innervation of leg muscles).
    Schirmer et al. 2011, J Neurosurg Spine 15:64 (root innervation by intraoperative stimulation).
    Sharrard 1964, Ann R Coll Surg Engl 35:106 (motor cell columns of the lower limb).
    Toossi et al. 2021, Sci Rep 11:1955 (lumbosacral enlargement, T12/L1 to S1/S2 in humans).

Dorsal and ventral roots are left out: their fluid is plain cerebrospinal fluid. Roots that are cut out of
a mesh which does not follow them corrupt the second derivative of the potential near the cord's rim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import UnknownNameError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """A neuronal segment of the cord: its length and the diameters at its middle, in mm."""

    name: str
    length: float
    width: float
    depth: float


# Diameters: L3 is 9.4 x 7.5 and T8 8.3 x 6.3 (Frostell 2016, weighted averages of 11 studies); ASSUMPTION:
# the values between and the taper towards the conus, whose shape follows Kameyama 1996.
# Lengths: decreasing steadily from T7 to the end of the cord (Clin Anat 1993, 6:167), the enlargement
# spanning T12/L1 to S1/S2 (Toossi 2021); ASSUMPTION: the single values, rounded to 1 mm.
SEGMENTS = (
    #       name length width depth
    Segment("T12", 18.0, 8.6, 6.9),
    Segment("L1", 15.0, 8.9, 7.1),
    Segment("L2", 12.0, 9.2, 7.3),
    Segment("L3", 11.0, 9.4, 7.5),
    Segment("L4", 10.0, 9.3, 7.5),
    Segment("L5", 9.0, 8.9, 7.3),
    Segment("S1", 8.0, 8.1, 6.8),
    Segment("S2", 7.0, 7.0, 6.1),
)
# ASSUMPTION: beyond S2 the conus tapers to the filum within 24 mm; (mm beyond S2, width, depth).
CONUS = ((5.0, 5.2, 4.6), (14.0, 3.2, 2.9), (24.0, 1.6, 1.6))
# ASSUMPTION: half of the grey matter's outline, in units of the cord's half width and half depth, drawn
# after the lumbar sections of Kameyama 1996 (broad ventral horns, thin commissure); scaled with the cord.
GREY_OUTLINE = (
    (0.00, 0.09), (0.13, 0.14), (0.22, 0.36), (0.30, 0.58), (0.38, 0.71), (0.50, 0.67), (0.48, 0.46),
    (0.42, 0.20), (0.46, 0.00), (0.60, -0.18), (0.64, -0.40), (0.53, -0.59), (0.32, -0.62), (0.20, -0.42),
    (0.14, -0.14), (0.00, -0.07),
)  # fmt: skip

# S/m, (across, along) the fibres. Capogrosso 2013, table 1: white 0.083/0.6, grey 0.23, CSF 1.7, epidural
# fat 0.04, bone 0.02. Dura 0.03, within the 0.02-0.6 of published models (Khadka 2025).
# ASSUMPTION: the silicone paddle 0.002, an insulator against all that touches it.
CONDUCTIVITIES: Mapping[str, tuple[float, float]] = {
    "grey": (0.23, 0.23),
    "white": (0.083, 0.6),
    "csf": (1.7, 1.7),
    "dura": (0.03, 0.03),
    "fat": (0.04, 0.04),
    "bone": (0.02, 0.02),
    "paddle": (0.002, 0.002),
}

# Where the motor pools lie, as (first, last) segment; "mid-X" is the middle of a segment. Sharrard 1964 for
# the rostrocaudal extent, Phillips & Park 1991 (vastus L3, tibialis L4, gluteus and gastrocnemius S1 as main
# roots) and Schirmer 2011 for the overlap. ASSUMPTION: the lower half of L4 as the rostral end of ST.
# The districts, and the rule for neighbours in `muscles`, were fixed before any selectivity was computed.
DISTRICTS: Mapping[str, tuple[str, str]] = {
    "IL": ("L1", "L3"),
    "VL&RF": ("L2", "L4"),
    "TA": ("L4", "L5"),
    "BF&GM": ("L5", "S2"),
    "ST": ("mid-L4", "S1"),
    "GA": ("S1", "S2"),
}

# The field map of the paper places contacts on a paddle of 52 x 14 pixels of 1 mm: 3 x 1 pixels each, top
# pixels at rows 6, 12, ..., 48 of column 3 and 3, 9, ..., 45 of column 6. The map's centre line is put on the
# cord's, so all 16 contacts lie LEFT of the midline.
CONTACT_LENGTH, CONTACT_WIDTH = 3.0, 1.0
CONTACT_TOPS = (np.arange(6, 49, 6) - 1.0, np.arange(3, 46, 6) - 1.0)  # mm below the paddle's rostral edge
CONTACT_CENTRES = (3 - 0.5, 6 - 0.5)  # mm from the paddle's left edge


@dataclass(frozen=True)
class Anatomy:
    """Dimensions in mm.

    Attributes:
        segments: the neuronal segments, rostral first.
        sac_width, sac_depth: inner diameters of the dural sac. ASSUMPTION, chosen so that the dorsal fluid at
            L3 is 3.25 mm thick: 1.5 to 4.5 mm at T12, supine (Holsheimer 1994).
        sac_exponent: |x/a|^n + |y/b|^n = 1 is the sac's outline. ASSUMPTION.
        dura: thickness; 0.307 +- 0.122 (Hong 2011).
        canal_width, canal_depth: of the ellipse that bounds the epidural fat. ASSUMPTION: it holds
            sac and paddle.
        body_radius: where the bone ends and the potential is zero. ASSUMPTION: balanced configurations
            have no far field.
        paddle_gap: fat between dura and paddle on the midline. ASSUMPTION.
        paddle_thickness: ASSUMPTION, a thin surgical paddle.
        paddle_width, paddle_length: 14 and 52, the field map's pixels.
        paddle_rostral_edge: z of the paddle's upper edge. ASSUMPTION: the paddle is centred on L1-S2.
        rostral_end, caudal_end: z of the insulated ends of the model. ASSUMPTION: 60 mm and more from any
            contact.
    """

    segments: tuple[Segment, ...] = SEGMENTS
    sac_width: float = 17.4
    sac_depth: float = 14.0
    sac_exponent: float = 2.6
    dura: float = 0.3
    canal_width: float = 25.0
    canal_depth: float = 22.0
    body_radius: float = 30.0
    paddle_gap: float = 0.25
    paddle_thickness: float = 1.2
    paddle_width: float = 14.0
    paddle_length: float = 52.0
    paddle_rostral_edge: float = 28.0
    rostral_end: float = -40.0
    caudal_end: float = 140.0

    def overridden(self, values: Mapping[str, float]) -> Anatomy:
        """A copy with other dimensions.

        Args:
            values: dimension -> mm; a segment's are `length_L3`, `width_L3`, `depth_L3`.

        Raises:
            UnknownNameError: no such dimension.
        """
        own = [f.name for f in fields(self) if f.name != "segments"]
        parts = [f"{what}_{s.name}" for s in self.segments for what in ("length", "width", "depth")]
        for name in values:
            if name not in own + parts:
                raise UnknownNameError("dimension of the anatomy", name, own + parts)
        segments = tuple(
            Segment(
                s.name,
                values.get(f"length_{s.name}", s.length),
                values.get(f"width_{s.name}", s.width),
                values.get(f"depth_{s.name}", s.depth),
            )
            for s in self.segments
        )
        return replace(self, segments=segments, **{name: values[name] for name in values if name in own})

    @property
    def borders(self) -> Array:
        """z of the segments' ends, shape (segments + 1,)."""
        return np.concatenate([[0.0], np.cumsum([s.length for s in self.segments])])

    @property
    def half_width(self) -> float:
        """Half width of the cord's reference section, that of the widest segment."""
        return max(s.width for s in self.segments) / 2

    @property
    def half_depth(self) -> float:
        """Half depth of the cord's reference section, that of the deepest segment."""
        return max(s.depth for s in self.segments) / 2

    @property
    def paddle_face(self) -> float:
        """y of the paddle's ventral face, where the contacts lie."""
        return self.sac_depth / 2 + self.dura + self.paddle_gap

    def sac_outline(self, angle: ArrayLike, outset: float = 0.0) -> Array:
        """Points of the sac's inner outline, grown by `outset` mm, at the parameter `angle`, shape (n, 2)."""
        c, s = np.cos(angle), np.sin(angle)
        power = 2 / self.sac_exponent
        x = (self.sac_width / 2 + outset) * np.sign(c) * np.abs(c) ** power
        y = (self.sac_depth / 2 + outset) * np.sign(s) * np.abs(s) ** power
        return np.stack([x, y], axis=-1)

    def contacts(self) -> Array:
        """Centres of the 16 contacts as (x, z), shape (16, 2)."""
        left = -self.paddle_width / 2
        columns = zip(CONTACT_CENTRES, CONTACT_TOPS, strict=True)
        return np.concatenate(
            [
                np.stack(
                    [np.full(len(top), left + x), self.paddle_rostral_edge + top + CONTACT_LENGTH / 2], axis=1
                )
                for x, top in columns
            ]
        )

    def place(self, name: str, *, end: bool) -> float:
        """z of the rostral (or, with `end`, caudal) border of a segment, or of the middle for "mid-L4"."""
        names = [s.name for s in self.segments]
        middle = name.startswith("mid-")
        segment = name.removeprefix("mid-")
        if segment not in names:
            raise UnknownNameError("segment", segment, names)
        i = names.index(segment)
        first, last = self.borders[i], self.borders[i + 1]
        return float((first + last) / 2 if middle else (last if end else first))
