"""Couches: loveseats, corner couches, chesterfields, futons and others."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    Kit,
    fabric,
    lacquer,
    metal,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cushion, cylinder, pillow, rod
from data_gen.mesh import Material


class _Seat:
    """Dimensions and materials common to all parts of a couch."""

    def __init__(self, kit: Kit) -> None:
        self.cover = fabric(kit.rng)
        self.soft = self.cover if kit.rng.random() < 0.6 else fabric(kit.rng)
        self.foot = pick(kit.rng, (wood, metal))(kit.rng)
        self.one = kit.uniform("seat_width", 0.5, 0.8)
        self.arm = kit.uniform("arm_width", 0.08, 0.32)
        self.depth = kit.uniform("depth", 0.75, 1.1)
        self.back = kit.uniform("back_thickness", 0.12, 0.28)
        self.seat = kit.uniform("seat_height", 0.34, 0.48)
        self.top = self.seat + kit.uniform("back_height", 0.25, 0.6)
        self.arm_top = self.seat + kit.uniform("arm_height", 0.05, 0.28)
        self.lift = 0.0 if kit.chance("skirt", 0.35) else kit.uniform("leg_height", 0.05, 0.18)
        self.floor = max(self.seat - 0.15, self.lift + 0.06)


def _base(kit: Kit, s: _Seat, depth: float, width: float, x: float = 0.0, y: float = 0.0) -> None:
    """The body below the seats. Only the first body of a couch has feet."""
    outline = rect(depth, width, 0.04)
    tall = s.floor - s.lift
    if "base_recess" not in kit.hidden:
        kit.add(s.cover, hollows.slab(kit, "base_recess", outline, tall, 0.06).at(x, y, s.lift))
    else:
        kit.add(s.cover, box(depth, width, tall, 0.02).at(x, y, s.lift + tall / 2))
    if s.lift:
        kit.visible.setdefault("foot", pick(kit.rng, ("square", "tapered", "round", "wedge")))
        style = kit.visible["foot"]
        for sx in (-1, 1):
            for sy in (-1, 1):
                for part in legs.leg(style, s.lift + 0.02, 0.05, (sx, sy), 1):
                    kit.add(
                        s.foot, part.at(x + sx * (depth / 2 - 0.07), y + sy * (width / 2 - 0.08))
                    )


def _cushions(
    kit: Kit, s: _Seat, count: int, y0: float, front: float, rear: float, backs: bool = True,
    width: float | None = None,
) -> None:  # fmt: skip
    """A row of seat cushions along y, centred at y0, and loose cushions against the back."""
    one = s.one if width is None else width / count
    puff = kit.visible.setdefault("puff", float(kit.rng.uniform(3, 9)))
    for k in range(count):
        y = y0 + (k - (count - 1) / 2) * one
        long = front - rear
        seat = cushion(long + 0.02, one - 0.008, 0.2, 9.0, puff)
        kit.add(s.soft, seat.at(rear + long / 2, y, s.seat - 0.08))
        if backs:
            tall = max(s.top - s.seat + 0.02, 0.2)
            loose = cushion(0.2, one - 0.02, tall, 3.0, 6.0)
            lean = loose.turned("y", -12).at(rear + 0.07, y, s.seat + tall / 2 - 0.02)
            kit.add(s.soft, lean)


def _arm(kit: Kit, s: _Seat, style: str, depth: float) -> list[tuple[Material, Solid]]:
    """An arm centred at y = 0, with its rear end at x = -depth / 2."""
    low, high, wide = s.floor - 0.06, s.arm_top, s.arm
    if style == "box":
        return [(s.cover, pillow(depth, wide, high - low, 0.03).at(0, 0, (high + low) / 2))]
    if style == "rolled":
        wide = min(wide, 0.22)
        body = pillow(depth, wide * 0.75, high - low, 0.02).at(0, 0, (high + low) / 2)
        roll = cylinder(wide * 0.62, depth * 0.99, 24, 0.02).turned("y", 90)
        return [(s.cover, body), (s.cover, roll.at(0, wide * 0.12, high))]
    if style == "sloped":
        shape = [
            (-0.5, low),
            (0.5, low),
            (0.5, high - 0.06),
            (0.3, high - 0.03),
            (-0.2, high + 0.12),
            (-0.5, high + 0.14),
        ]
        return [(s.cover, solids.prism([(a * depth, z) for a, z in shape], wide, 0.02))]
    if style == "flared":
        path = solids.rise(lambda t: (0, (t * t - 0.3) * wide, low + t * (high - low)), 8)
        section = solids.rounded(depth, 0.1, 0.04, 3)
        return [(s.cover, solids.sweep(section, path, (1, 0, 0)))]
    if style == "wooden":
        post = box(0.05, 0.05, high, 0.006)
        rail = cushion(depth * 0.95, 0.09, 0.04, 3.0, 4.0).at(0, 0, high)
        parts = [post.at(x * depth, 0, high / 2) for x in (-0.38, 0.38)]
        parts += [
            box(0.02, 0.03, high - low).at(x * depth, 0, (high + low) / 2) for x in (-0.2, 0, 0.2)
        ]
        return [(s.foot, part) for part in (*parts, rail)]
    # "tube": a loop of steel tube
    half = depth * 0.45
    loop = [(-half, 0, 0.02), (half, 0, 0.02), (half, 0, high), (-half, 0, high)]
    closed = [*loop, loop[0], loop[1]]
    return [(CHROME, solids.tube(np.array(closed), 0.018))]


def _straight(kit: Kit) -> None:
    """Two to four seats between two arms."""
    s = _Seat(kit)
    seats = kit.choose("seats", 2, 3, 3, 4)
    style = kit.choose("arm", "box", "rolled", "sloped", "flared", "wooden", "tube")
    width = seats * s.one
    _base(kit, s, s.depth, width + 0.02)
    rear, front = -s.depth / 2, s.depth / 2
    wide_back = kit.chance("back_over_arms", 0.4) and style in ("box", "rolled")
    length = width + (2 * s.arm if wide_back else 0.04)
    tall = s.top - s.floor + 0.04
    kind = kit.choose("back", "plain", "camel", "low", "roll", "split")
    if kind == "camel":
        y = np.linspace(-0.5, 0.5, 21)
        hump = 0.12 * np.cos(y * 2 * np.pi) + 0.02
        outline = [(a * length, b) for a, b in zip(y, tall + hump, strict=True)]
        shape = np.array([(-length / 2, 0), (length / 2, 0), *outline[::-1]])
        board = solids.prism(shape, s.back, 0.04).turned("z", 90)
        kit.add(s.cover, board.at(rear + s.back / 2, 0, s.floor - 0.02))
    elif kind == "split":
        for k in range(seats):
            part = pillow(s.back, s.one - 0.01, tall, 0.07).turned("y", -7)
            kit.add(
                s.cover,
                part.at(rear + s.back / 2, (k - (seats - 1) / 2) * s.one, s.floor + tall / 2),
            )
    else:
        tall *= 0.7 if kind == "low" else 1
        board = pillow(s.back, length, tall, 0.06).turned("y", -kit.uniform("lean", 0, 10))
        kit.add(s.cover, board.at(rear + s.back / 2, 0, s.floor + tall / 2))
        if kind == "roll":
            roll = cylinder(s.back * 0.55, length, 24, 0.03).turned("x", 90)
            kit.add(s.cover, roll.at(rear + s.back * 0.35, 0, s.floor + tall))
    y = width / 2 + (s.arm / 2 if style in ("box", "sloped") else 0.06)
    for material, part in _arm(kit, s, style, s.depth):
        kit.both(material, part.at(y=y))
    _cushions(kit, s, seats, 0, front, rear + s.back, kit.chance("loose_backs", 0.6))
    _throws(kit, s, width / 2 - 0.2, rear + s.back + 0.2)


def _throws(kit: Kit, s: _Seat, y: float, x: float) -> None:
    """Adds throw cushions at the ends."""
    if not kit.chance("throw_cushions", 0.45):
        return
    loose = fabric(kit.rng)
    size = kit.uniform("throw_size", 0.32, 0.5)
    for side in (-1, 1)[: kit.choose("throws", 1, 2, 2)]:
        soft = cushion(0.16, size, size, 4.0, 1.3).turned("y", 0)
        flat = cushion(size, size, 0.16, 5.0, 1.2).turned("y", 68).turned("z", -side * 15)
        kit.add(loose, (flat if size > 0.34 else soft).at(x + 0.06, side * y, s.seat + size * 0.45))


def _chesterfield(kit: Kit) -> None:
    """Back and arms of the same height, rolled and buttoned."""
    s = _Seat(kit)
    seats = kit.choose("seats", 1, 2, 3)
    width, high = seats * s.one + 0.3, s.seat + kit.uniform("high", 0.2, 0.32)
    roll = kit.uniform("roll", 0.09, 0.15)
    _base(kit, s, s.depth, width)
    rear = -s.depth / 2
    kit.add(
        s.cover, pillow(0.16, width, high - s.floor, 0.04).at(rear + 0.1, 0, (high + s.floor) / 2)
    )
    kit.both(
        s.cover,
        pillow(s.depth - 0.06, 0.15, high - s.floor, 0.04).at(
            0, width / 2 - 0.1, (high + s.floor) / 2
        ),
    )
    x, y = rear + 0.06, width / 2 - 0.06
    corner = [
        (s.depth / 2 - 0.02, -y, high),
        (0, -y, high),
        (x + 0.12, -y, high),
        (x, -y + 0.12, high),
        (x, 0, high),
        (x, y - 0.12, high),
        (x + 0.12, y, high),
        (0, y, high),
        (s.depth / 2 - 0.02, y, high),
    ]
    kit.add(s.cover, solids.tube(solids.smooth_path(corner, 4), roll, 18))
    _cushions(kit, s, seats, 0, s.depth / 2, rear + 0.2, False, width - 0.32)
    inner = np.linspace(-0.5, 0.5, 4 * seats + 2) * (width - 0.4)
    for row, z in enumerate((0.35, 0.7)):
        for b in inner[row % 2 :: 2]:
            dot = ball(0.02, 0.04, 0.04, 8)
            kit.add(BLACK, dot.at(rear + 0.185, float(b), s.seat + z * (high - s.seat)))


def _corner(kit: Kit) -> None:
    """Two or three rows of seats around a corner."""
    s = _Seat(kit)
    mirror = kit.choose("mirror", -1, 1)
    long, short = kit.choose("long", 2, 3, 4), kit.choose("short", 1, 2, 3)
    u_shape = kit.chance("u_shape", 0.3)
    width, wing = long * s.one + s.depth, short * s.one
    if u_shape:
        width += s.depth
    x0 = -(s.depth + wing) / 2  # the rear edge of the long row
    armless = kit.chance("armless", 0.4)
    tall = s.top - s.floor
    back_z = s.floor + tall / 2
    _base(kit, s, s.depth, width, x0 + s.depth / 2)
    kit.add(s.cover, pillow(s.back, width, tall, 0.06).at(x0 + s.back / 2, 0, back_z))
    sides = (mirror, -mirror) if u_shape else (mirror,)
    for side in sides:
        y = side * (width / 2 - s.depth / 2)
        x = x0 + s.depth + wing / 2
        _base(kit, s, wing, s.depth, x, y)
        board = pillow(wing + s.depth, s.back, tall, 0.06)
        kit.add(s.cover, board.at(x - s.depth / 2, side * (width / 2 - s.back / 2), back_z))
        one = wing / short
        for k in range(short):
            seat = cushion(one - 0.008, s.depth - s.back, 0.2, 9.0, 5.0)
            at_x, at_y = x0 + s.depth + (k + 0.5) * one, y - side * s.back / 2
            kit.add(s.soft, seat.at(at_x, at_y, s.seat - 0.08))
            loose = cushion(one - 0.02, 0.2, tall, 3.0, 6.0)
            kit.add(
                s.soft, loose.at(at_x, side * (width / 2 - s.back - 0.07), s.seat + tall / 2 - 0.05)
            )
        if not armless:
            end = pillow(s.arm, s.depth, s.arm_top - s.floor + 0.06, 0.04)
            kit.add(
                s.cover,
                end.at(x0 + s.depth + wing + s.arm / 2, y, (s.arm_top + s.floor) / 2 - 0.03),
            )
    inner = width - 2 * s.back if u_shape else width - s.back
    shift = 0.0 if u_shape else -mirror * s.back / 2
    count = long + (2 if u_shape else 1)
    _cushions(kit, s, count, shift, x0 + s.depth, x0 + s.back, True, inner)
    if not armless and not u_shape:
        arm = pillow(s.depth, s.arm, s.arm_top - s.floor + 0.06, 0.04)
        kit.add(
            s.cover,
            arm.at(
                x0 + s.depth / 2,
                -mirror * (width / 2 + s.arm / 2),
                (s.arm_top + s.floor) / 2 - 0.03,
            ),
        )


def _chaise_end(kit: Kit) -> None:
    """A couch with one long seat at its end."""
    s = _Seat(kit)
    side, seats = kit.choose("side", -1, 1), kit.choose("seats", 1, 2, 3)
    extra = kit.uniform("chaise", 0.4, 0.9)
    width = (seats + 1) * s.one
    rear = -s.depth / 2
    _base(kit, s, s.depth, width)
    y = side * (width / 2 - s.one / 2)
    _base(kit, s, extra + 0.1, s.one, s.depth / 2 + extra / 2 - 0.05, y)
    tall = s.top - s.floor
    kit.add(s.cover, pillow(s.back, width, tall, 0.06).at(rear + s.back / 2, 0, s.floor + tall / 2))
    _cushions(kit, s, seats, -side * s.one / 2, s.depth / 2, rear + s.back)
    _cushions(kit, s, 1, y, s.depth / 2 + extra, rear + s.back)
    for material, part in _arm(kit, s, kit.choose("arm", "box", "sloped", "rolled"), s.depth):
        kit.add(
            material, (part if side < 0 else part.mirrored()).at(y=-side * (width / 2 + s.arm / 2))
        )
    if kit.chance("both_arms", 0.5):
        for material, part in _arm(kit, s, "box", s.depth):
            kit.add(material, part.at(y=side * (width / 2 + s.arm / 2)))


def _longue(kit: Kit) -> None:
    """A chaise longue: a body that curves up at one end."""
    s = _Seat(kit)
    length, wide = kit.uniform("length", 1.5, 2.0), kit.uniform("width", 0.55, 0.85)
    low, high = kit.uniform("low", 0.3, 0.42), kit.uniform("high", 0.7, 1.05)
    style = kit.choose("style", "wave", "block", "recamier")
    if style == "wave":
        path = solids.smooth_path(
            [
                (0, -length / 2, low * 0.8),
                (0, -length * 0.25, low),
                (0, length * 0.12, low * 0.75),
                (0, length * 0.38, (low + high) / 2),
                (0, length / 2, high),
            ],
            6,
        )
        thick = kit.uniform("thickness", 0.08, 0.16)
        kit.add(s.cover, solids.sweep(solids.rounded(wide, thick, 0.05, 3), path, (1, 0, 0)))
        foot = hollows.slab(kit, "base_recess", rect(wide * 0.7, length * 0.4, 0.05), 0.05)
        kit.add(s.foot, foot)
        kit.add(
            s.foot,
            *(
                rod((0, y, 0.03), (0, y * 1.2, low * 0.8), 0.03)
                for y in (-0.2 * length, 0.15 * length)
            ),
        )
        return
    s.seat, s.lift = low + 0.1, kit.uniform("leg", 0.06, 0.2)
    s.floor = max(s.seat - 0.15, s.lift + 0.05)
    _base(kit, s, wide, length)
    kit.add(s.soft, cushion(wide, length * 0.96, 0.2, 8.0, 5.0).at(0, 0, s.seat - 0.07))
    end = length / 2
    if style == "block":
        kit.add(
            s.cover,
            pillow(wide, 0.16, high - s.floor, 0.06)
            .turned("x", -kit.uniform("lean", 4, 28))
            .at(0, end - 0.05, (high + s.floor) / 2),
        )
    else:
        path = solids.smooth_path(
            [
                (0, end - 0.2, s.seat - 0.1),
                (0, end - 0.08, s.seat + 0.1),
                (0, end + 0.02, high - 0.1),
                (0, end + 0.16, high - 0.06),
            ],
            5,
        )
        kit.add(s.cover, solids.sweep(solids.rounded(wide, 0.1, 0.04, 3), path, (1, 0, 0)))
        kit.add(
            s.cover,
            pillow(0.1, length * 0.6, high - s.floor - 0.15, 0.04).at(
                -wide / 2 + 0.05, length * 0.2, (high - 0.15 + s.floor) / 2
            ),
        )
        roll = cylinder(0.09, wide, 18, 0.02).turned("y", 90)
        kit.add(s.soft, roll.at(0, -end + 0.12, s.seat + 0.1))


def _sofa_bed(kit: Kit) -> None:
    """A sofa bed, pulled out: a long flat mattress in front of a back."""
    s = _Seat(kit)
    seats = kit.choose("seats", 2, 3)
    width, long = seats * s.one, kit.uniform("bed", 1.5, 2.0)
    rear = -long / 2
    _base(kit, s, s.depth, width, rear + s.depth / 2)
    kit.add(s.soft, cushion(long, width - 0.04, 0.18, 9.0, 4.0).at(0.05, 0, s.seat - 0.07))
    kit.both(
        s.foot,
        rod((long / 2 - 0.15, width * 0.4, 0), (long / 2 - 0.15, width * 0.4, s.seat - 0.1), 0.02),
    )
    tall = s.top - s.floor
    kit.add(s.cover, pillow(s.back, width, tall, 0.06).at(rear + s.back / 2, 0, s.floor + tall / 2))
    for material, part in _arm(kit, s, kit.choose("arm", "box", "sloped", "wooden"), s.depth):
        kit.both(material, part.at(rear + s.depth / 2, width / 2 + s.arm / 2))
    for k in range(kit.choose("pillows", 0, 2, 2)):
        soft = cushion(0.45, width * 0.4, 0.16, 4.0, 1.6).turned("y", -15)
        kit.add(
            fabric(kit.rng), soft.at(rear + s.back + 0.25, (k - 0.5) * width * 0.5, s.seat + 0.1)
        )


def _daybed(kit: Kit) -> None:
    """A frame with a mattress and ends, with or without a back."""
    s = _Seat(kit)
    length, depth = kit.uniform("length", 1.7, 2.1), kit.uniform("bed_depth", 0.75, 1.0)
    seat = kit.uniform("frame_height", 0.25, 0.42)
    frame = pick(kit.rng, (wood, metal, lacquer))(kit.rng)
    kit.add(frame, hollows.slab(kit, "base_recess", rect(depth, length), 0.1).at(z=seat - 0.1))
    kit.add(s.soft, cushion(depth - 0.04, length - 0.06, 0.2, 9.0, 6.0).at(z=seat + 0.07))
    ends = kit.choose("ends", "none", "boards", "spindles", "scrolls", "bolsters")
    high = seat + kit.uniform("end_height", 0.25, 0.5)
    legs.four(kit, depth / 2 - 0.04, length / 2 - 0.04, seat - 0.08, frame)
    y = length / 2
    if ends == "boards":
        kit.both(frame, box(depth, 0.05, high - seat + 0.1, 0.01).at(0, y, (high + seat - 0.1) / 2))
    elif ends == "spindles":
        for x in np.linspace(-0.46, 0.46, 6) * depth:
            kit.both(frame, rod((float(x), y, seat - 0.05), (float(x), y, high), 0.014))
        kit.both(frame, box(depth, 0.05, 0.05, 0.01).at(0, y, high))
    elif ends == "scrolls":
        path = solids.smooth_path(
            [
                (0, y - 0.05, seat - 0.05),
                (0, y, seat + 0.1),
                (0, y + 0.04, high - 0.06),
                (0, y + 0.14, high),
            ],
            5,
        )
        kit.both(frame, solids.sweep(solids.rounded(depth, 0.05, 0.02, 2), path, (1, 0, 0)))
    elif ends == "bolsters":
        kit.both(
            s.cover,
            cylinder(0.11, depth * 0.95, 20, 0.03).turned("y", 90).at(0, y - 0.14, seat + 0.26),
        )
    if kit.chance("back", 0.5):
        rear = -depth / 2
        kit.add(frame, box(0.05, length, 0.05, 0.01).at(rear, 0, high))
        for b in np.linspace(-0.48, 0.48, 9) * length:
            kit.add(frame, rod((rear, float(b), seat - 0.05), (rear, float(b), high), 0.014))


def _futon(kit: Kit) -> None:
    """A folded mattress on slats, or on the floor."""
    s = _Seat(kit)
    frame = pick(kit.rng, (wood, wood, metal))(kit.rng)
    length, depth = kit.uniform("length", 1.4, 2.1), kit.uniform("seat_depth", 0.6, 0.9)
    seat = kit.choose("level", 0.08, 0.3, 0.36)
    lean, tall = kit.uniform("lean", 15, 40), kit.uniform("back_height", 0.5, 0.75)
    kit.add(frame, hollows.slab(kit, "base_recess", rect(depth, length), 0.06).at(z=seat - 0.06))
    kit.add(s.cover, cushion(depth, length * 0.98, 0.2, 8.0, 3.0).at(z=seat + 0.08))
    rear = -depth / 2
    kit.add(
        s.cover,
        cushion(0.2, length * 0.98, tall, 3.0, 8.0)
        .turned("y", -lean)
        .at(rear - tall * 0.2, 0, seat + 0.08 + tall * 0.42),
    )
    for y in np.linspace(-0.45, 0.45, 7) * length:
        way = (
            rear - tall * np.sin(np.radians(lean)) - 0.1,
            float(y),
            seat + tall * np.cos(np.radians(lean)),
        )
        kit.add(frame, rod((rear - 0.04, float(y), seat - 0.05), way, 0.02, 6))
    if seat > 0.2:
        for sign in (-1, 1):
            for b in (-1, 1):
                kit.add(
                    frame,
                    box(0.06, 0.06, seat, 0.006).at(
                        sign * depth * 0.44, b * (length / 2 + 0.02), seat / 2
                    ),
                )
        if kit.chance("arms", 0.6):
            kit.both(
                frame, box(depth * 1.2, 0.08, 0.035, 0.008).at(0, length / 2 + 0.02, seat + 0.28)
            )
            for sign in (-1, 1):
                kit.both(
                    frame,
                    box(0.05, 0.05, 0.3).at(sign * depth * 0.5, length / 2 + 0.02, seat + 0.13),
                )


def _modular(kit: Kit) -> None:
    """Modules in a row, some with backs; one of them may stand apart as a stool."""
    s = _Seat(kit)
    one, tall = kit.uniform("block", 0.7, 0.95), s.top - s.seat
    rows = kit.choose(
        "plan",
        ((1, 1, 1), (0, 0, 1)),
        ((1, 1), (1, 0)),
        ((1, 1, 1, 1), (0, 0, 0, 0)),
        ((1, 1, 1), (1, 0, 1)),
        ((1, 1), (0, 0)),
    )
    backs = kit.choose("backs", "rear", "rear", "all", "none")
    soft = kit.uniform("softness", 2.5, 8)
    cells = [
        (float(i), float(j)) for i, row in enumerate(rows) for j, used in enumerate(row) if used
    ]
    if all(i == 0 for i, _ in cells) and kit.chance("stool", 0.7):
        cells.append((1.4, 0.0))
    share = kit.hide("base_recess", *hollows.RANGE)
    for i, j in cells:
        x, y = i * one, (j - (len(rows[0]) - 1) / 2) * one
        tray = solids.tray(rect(one - 0.02, one - 0.02, 0.05), 0.12, 0.05, share * 0.12)
        kit.add(s.cover, tray.at(x, y, 0.02))
        block = cushion(one - 0.01, one - 0.01, s.seat - 0.06, 7.0, soft)
        kit.add(s.soft, block.at(x, y, s.seat / 2 + 0.05))
        if i == 0 and backs != "none":
            kit.add(
                s.cover,
                cushion(0.22, one - 0.02, tall + 0.1, 4.0, soft).at(
                    x - one / 2 + 0.11, y, s.seat + tall / 2 - 0.03
                ),
            )
        if backs == "all" and j in (0, len(rows[0]) - 1) and i != 1.4:
            side = -1 if j == 0 else 1
            kit.add(
                s.cover,
                cushion(one - 0.02, 0.22, tall + 0.1, 4.0, soft).at(
                    x, y + side * (one / 2 - 0.11), s.seat + tall / 2 - 0.03
                ),
            )


def _curved(kit: Kit) -> None:
    """A curved couch."""
    s = _Seat(kit)
    radius, sweep = kit.uniform("radius", 0.9, 2.0), np.radians(kit.uniform("sweep", 60, 190))
    depth = kit.uniform("seat_depth", 0.6, 0.85)

    def arc(r: float, share: float = 1.0) -> np.ndarray:
        half = share * sweep / 2
        return solids.rise(
            lambda t: (-r * np.cos(half * (2 * t - 1)), r * np.sin(half * (2 * t - 1)), 0), 24
        )

    across = (0, 0, 1)
    outer = arc(radius)
    ring = np.concatenate([arc(radius)[:, :2], arc(radius - depth)[::-1, :2]])
    low = max(s.lift, 0.04)
    shift = -float(ring[:, 0].mean())
    seat = solids.sweep(
        solids.rounded(s.seat - low, depth, 0.06, 3), arc(radius - depth / 2), across
    )
    kit.add(s.cover, seat.at(shift, 0, (s.seat + low) / 2))
    tall = s.top - s.seat + 0.1
    back = solids.sweep(solids.rounded(tall, 0.2, 0.08, 3), outer, across)
    kit.add(s.cover, back.at(shift, 0, s.seat + tall / 2 - 0.1))
    feet = kit.choose("feet", 3, 4, 5)
    share = kit.hide("base_recess", *hollows.RANGE)
    for t in np.linspace(-0.42, 0.42, feet) * sweep:
        x, y = -(radius - depth / 2) * np.cos(t), (radius - depth / 2) * np.sin(t)
        foot = solids.tray(rect(depth * 0.5, depth * 0.5, 0.05), low + 0.02, 0.03, share * low)
        kit.add(s.foot, foot.turned("z", -np.degrees(t)).at(x + shift, y))
    if kit.chance("loose", 0.5):
        for t in np.linspace(-0.36, 0.36, kit.choose("loose_count", 2, 3, 4)) * sweep:
            soft = cushion(0.18, 0.45, 0.42, 4.0, 1.6).turned("y", -15).turned("z", -np.degrees(t))
            r = radius - 0.22
            kit.add(s.soft, soft.at(-r * np.cos(t) + shift, r * np.sin(t), s.seat + 0.2))


def _bench_like(kit: Kit) -> None:
    """Slim seats on a metal frame, for waiting rooms or in the style of the 1950s."""
    s = _Seat(kit)
    seats = kit.choose("seats", 2, 3, 4, 5)
    width, depth = seats * s.one, kit.uniform("seat_depth", 0.55, 0.75)
    level = kit.uniform("level", 0.34, 0.45)
    frame = metal(kit.rng)
    kit.add(
        frame,
        hollows.slab(kit, "base_recess", rect(depth * 0.6, width * 0.96), 0.05, 0.02).at(
            z=level - 0.1
        ),
    )
    tall, lean = kit.uniform("back_height", 0.28, 0.5), kit.uniform("lean", 5, 20)
    split = kit.chance("split", 0.6)
    for k in range(seats if split else 1):
        y = (k - (seats - 1) / 2) * s.one if split else 0.0
        one = s.one - 0.03 if split else width
        kit.add(s.cover, pillow(depth, one, 0.1, 0.04).at(0, y, level))
        kit.add(
            s.cover,
            pillow(0.09, one, tall, 0.04)
            .turned("y", -lean)
            .at(-depth / 2 - 0.02, y, level + 0.1 + tall / 2),
        )
    for y in np.linspace(-0.44, 0.44, kit.choose("supports", 2, 3)) * width:
        for sign in (-1, 1):
            kit.add(
                frame,
                rod(
                    (sign * depth * 0.42, float(y), 0),
                    (sign * depth * 0.3, float(y), level - 0.06),
                    0.018,
                ),
            )
        kit.add(
            frame,
            rod(
                (-depth * 0.3, float(y), level - 0.08),
                (-depth * 0.56, float(y), level + 0.2 + tall * 0.6),
                0.015,
            ),
        )
    if kit.chance("arms", 0.4):
        for material, part in _arm(kit, s, "tube", depth):
            kit.both(material, part.at(y=width / 2 + 0.04))


def _group(kit: Kit) -> None:
    """A couch with another couch or with armchairs, and perhaps a table between them."""
    s = _Seat(kit)
    style = kit.choose("arm", "box", "rolled", "sloped")

    def couch(x: float, y: float, turn: float, seats: int) -> None:
        start = len(parts)
        width = seats * s.one
        rear = -s.depth / 2
        parts.append(
            (
                s.cover,
                solids.tray(
                    rect(s.depth, width + 0.02, 0.04),
                    s.floor - s.lift,
                    0.06,
                    share * (s.floor - s.lift),
                ).at(z=s.lift),
            )
        )
        for a in (-1, 1):
            for b in (-1, 1):
                parts.append(
                    (
                        s.foot,
                        cylinder(0.03, s.lift + 0.02, 10).at(
                            a * (s.depth / 2 - 0.07), b * (width / 2 - 0.07), s.lift / 2
                        ),
                    )
                )
        tall = s.top - s.floor
        parts.append(
            (
                s.cover,
                pillow(s.back, width, tall, 0.06).at(rear + s.back / 2, 0, s.floor + tall / 2),
            )
        )
        for material, part in _arm(kit, s, style, s.depth):
            parts.append((material, part.at(y=width / 2 + s.arm / 2)))
            parts.append((material, part.at(y=width / 2 + s.arm / 2).mirrored()))
        for k in range(seats):
            soft = cushion(s.depth - s.back, s.one - 0.01, 0.2, 9.0, 5.0, 20)
            parts.append(
                (s.soft, soft.at(s.back / 2, (k - (seats - 1) / 2) * s.one, s.seat - 0.08))
            )
        parts[start:] = [(m, p.turned("z", turn).at(x, y)) for m, p in parts[start:]]

    parts: list[tuple[Material, Solid]] = []
    share = kit.hide("base_recess", *hollows.RANGE)
    long, far = kit.choose("long", 2, 3), kit.uniform("distance", 1.2, 1.8)
    couch(-far * 0.5, 0, 0, long)
    plan = kit.choose("plan", "facing", "side", "both_sides", "facing_pair")
    side = long * s.one / 2 + 0.35 + s.depth / 2
    if plan == "facing":
        couch(far, 0, 180, long)
    elif plan == "facing_pair":
        apart = s.one / 2 + s.arm + 0.25
        couch(far, apart, 165, 1)
        couch(far, -apart, -165, 1)
    else:
        couch(far * 0.35, side, -90, kit.choose("short", 1, 2))
        if plan == "both_sides":
            couch(far * 0.35, -side, 90, 1)
    for material, part in parts:
        kit.add(material, part)
    if kit.chance("table", 0.6):
        top = box(0.5, 0.9, 0.04, 0.01).at(far * 0.3, 0, 0.36)
        kit.add(
            s.foot,
            top,
            *(
                box(0.05, 0.05, 0.35).at(far * 0.3 + a * 0.2, b * 0.4, 0.175)
                for a in (-1, 1)
                for b in (-1, 1)
            ),
        )


def _loveseat(kit: Kit) -> None:
    """Two seats in a rounded tub."""
    s = _Seat(kit)
    wide, depth = kit.uniform("width", 1.1, 1.6), kit.uniform("tub_depth", 0.7, 0.95)
    low = max(s.lift, 0.03)
    flat = solids.superellipse(depth, wide, kit.uniform("roundness", 2.2, 5), 36)
    kit.add(
        s.cover,
        hollows.body(kit, [(flat * 0.92, low), (flat, low + 0.05), (flat, s.seat - 0.1)], 0.08),
    )
    legs.four(kit, depth * 0.34, wide * 0.38, low + 0.03, s.foot, "round", "tapered")
    # The wall: around the rear and the sides, lower toward the front.
    angle = np.linspace(np.radians(70), np.radians(290), 25)
    thick = kit.uniform("wall", 0.07, 0.16)
    high, drop = s.top, kit.uniform("drop", 0.0, 1.0)
    rows = []
    for t in np.linspace(0, 1, 5):
        power = 2 / 3.0
        x = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power * (depth / 2 + 0.06 * t)
        y = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power * (wide / 2 + 0.06 * t)
        share = 1 - drop * 0.6 * np.clip((np.cos(angle) + 0.6) / 1.0, 0, 1)
        bottom = s.seat - 0.2
        rows.append(np.stack([x, y, bottom + t * (high - bottom) * share], axis=1))
    kit.add(s.cover, solids.sheet(np.array(rows), thick))
    kit.add(s.soft, cushion(depth * 0.94, wide * 0.92, 0.2, 4.0, 4.0).at(0.02, 0, s.seat - 0.08))


def _settee(kit: Kit) -> None:
    """A slender settee with a shaped wooden back and high legs."""
    s = _Seat(kit)
    frame = wood(kit.rng)
    width, depth = kit.uniform("width", 1.1, 1.9), kit.uniform("settee_depth", 0.5, 0.65)
    seat = kit.uniform("level", 0.38, 0.46)
    kit.add(
        frame, hollows.slab(kit, "base_recess", rect(depth, width, 0.03), 0.08).at(z=seat - 0.1)
    )
    kit.add(s.cover, cushion(depth * 0.96, width * 0.96, 0.14, 7.0, 2.5).at(z=seat + 0.01))
    legs.four(
        kit,
        depth / 2 - 0.03,
        width / 2 - 0.04,
        seat - 0.09,
        frame,
        "cabriole",
        "turned",
        "sabre",
        "tapered",
    )
    tall = kit.uniform("tall", 0.38, 0.6)
    waves = kit.choose("waves", 1, 2, 3)
    y = np.linspace(-0.5, 0.5, 31)
    top = tall * (0.82 + 0.18 * np.abs(np.cos(np.pi * waves * y)))
    lean = kit.uniform("lean", 5, 14)
    loop = [(0.0, float(a) * width, float(b)) for a, b in zip(y, top, strict=True)]
    curve = np.array([(0, -width / 2, -0.05), *loop, (0, width / 2, -0.05)])
    kit.add(frame, solids.tube(curve, 0.025).turned("y", -lean).at(-depth / 2 + 0.02, 0, seat))
    kit.add(
        frame,
        rod((0, -width / 2, 0.12), (0, width / 2, 0.12), 0.018)
        .turned("y", -lean)
        .at(-depth / 2 + 0.02, 0, seat),
    )
    if kit.chance("upholstered", 0.6):
        pad = np.array(
            [(a * width * 0.94, 0.14) for a in (-0.5, 0.5)]
            + [(a * width * 0.94, b * 0.94) for a, b in zip(y[::-1], top[::-1], strict=True)]
        )
        board = solids.prism(pad, 0.05, 0.01).turned("z", 90)
        kit.add(s.cover, board.turned("y", -lean).at(-depth / 2 + 0.02, 0, seat))
    else:
        for a in np.linspace(-0.46, 0.46, int(width / 0.11)):
            kit.add(
                frame,
                rod((0, a * width, 0.1), (0, a * width, tall * 0.84), 0.009, 6)
                .turned("y", -lean)
                .at(-depth / 2 + 0.02, 0, seat),
            )
    arm = solids.smooth_path(
        [
            (-depth / 2, 0, seat + 0.24),
            (0, 0, seat + 0.23),
            (depth * 0.35, 0, seat + 0.22),
            (depth * 0.4, 0, seat + 0.12),
            (depth * 0.36, 0, seat - 0.04),
        ],
        5,
    )
    kit.both(frame, solids.tube(arm, 0.022).at(y=width / 2 - 0.01))


KINDS: dict[str, Callable[[Kit], None]] = {
    "straight": _straight, "loveseat": _loveseat, "chesterfield": _chesterfield, "corner": _corner,
    "chaise": _chaise_end, "longue": _longue, "sofa_bed": _sofa_bed, "daybed": _daybed,
    "futon": _futon, "modular": _modular, "curved": _curved, "slim": _bench_like, "group": _group,
    "settee": _settee,
}  # fmt: skip

_WEIGHTS = {"straight": 5, "corner": 2, "loveseat": 2}


def couch(kit: Kit) -> None:
    """Fourteen subtypes, see `KINDS`. Hidden: the depth of the recess in the underside."""
    kit.build_subtype(KINDS, _WEIGHTS)
