"""Diagrams of the paper's figures 2.1, 4.1, 4.3 and 5.4: the identification loop, the motor, its blocks, the bench."""

from __future__ import annotations

from emsid.report.document import Box, Circle, Diagram, Text, Wire

Shape = Box | Circle | Wire | Text


def identification_loop() -> Diagram:
    """Figure 2.1 with the loop around it: plant and model get the same input, the estimator the difference."""
    return Diagram(
        "identification-loop",
        "Identification of a linear–static–linear model (Figure 2.1): plant and model get the same input, and the "
        "parameters are estimated from the difference of their outputs.",
        640,
        232,
        (
            Text(22, 132, "u(t)"),
            Wire(((40, 128), (104, 128))),
            Wire(((70, 128), (70, 36), (230, 36))),
            Box(230, 14, 150, 44, ("drive, motor and load",)),
            Wire(((380, 36), (560, 36), (560, 118))),
            Text(470, 28, "y(t)"),
            Box(104, 104, 108, 48, ("linear (5.1)", "FIR filter")),
            Text(228, 120, "x(t)"),
            Wire(((212, 128), (244, 128))),
            Box(244, 104, 108, 48, ("static (5.3)", "polynomial")),
            Text(368, 120, "z(t)"),
            Wire(((352, 128), (384, 128))),
            Box(384, 104, 108, 48, ("linear (5.5)", "ARX")),
            Text(518, 120, "ŷ(t)"),
            Wire(((492, 128), (550, 128))),
            Circle(560, 128, 10, "Σ"),
            Text(572, 114, "+"),
            Text(542, 144, "−"),
            Wire(((570, 128), (600, 128), (600, 206), (500, 206))),
            Text(616, 170, "ε(t)"),
            Box(330, 184, 170, 40, ("least squares, LS or RLS",)),
            Wire(((330, 206), (58, 206), (58, 166), (438, 166)), arrow=False),
            Text(190, 198, "parameters θ"),
            Wire(((158, 166), (158, 152))),
            Wire(((298, 166), (298, 152))),
            Wire(((438, 166), (438, 152))),
        ),
    )


def _resistor(x: float, y: float) -> Wire:
    steps = [(x, y), *((x + 5 + 8 * k, y + (-7 if k % 2 == 0 else 7)) for k in range(5)), (x + 42, y)]
    return Wire(tuple(steps), arrow=False)


def _coil(x: float, y: float) -> tuple[Wire, ...]:
    def arc(a: float) -> Wire:
        points = ((0, 0), (1.2, -5), (4, -8), (7, -8.5), (10, -8), (12.8, -5), (14, 0))
        return Wire(tuple((a + dx, y + dy) for dx, dy in points), arrow=False)

    return tuple(arc(x + 14 * k) for k in range(3))


def _spring(x: float, y: float) -> Wire:
    steps = [(x, y), (x + 8, y), *((x + 12 + 8 * k, y + (-8 if k % 2 == 0 else 8)) for k in range(6)), (x + 56, y)]
    return Wire((*steps, (x + 66, y)), arrow=False)


def motor_schematic() -> Diagram:
    """Figure 4.1: the armature circuit and the two masses."""
    return Diagram(
        "motor-schematic",
        "The permanent-magnet DC motor with its load (Figure 4.1): armature circuit (4.1) to (4.3), rotor, shaft and "
        "load (4.4) to (4.6).",
        640,
        180,
        (
            Circle(36, 92, 16, "v_a"),
            Wire(((36, 76), (36, 36), (62, 36)), arrow=False),
            _resistor(62, 36),
            Text(83, 20, "R_a"),
            Wire(((104, 36), (124, 36)), arrow=False),
            *_coil(124, 36),
            Text(145, 18, "L_a"),
            Wire(((166, 36), (214, 36), (214, 72)), arrow=False),
            Wire(((176, 48), (202, 48))),
            Text(188, 62, "i_a"),
            Circle(214, 92, 20, "e_a"),
            Wire(((214, 112), (214, 150), (36, 150), (36, 108)), arrow=False),
            Text(126, 168, "e_a = K_m·ω_m,  T_m = K_m·i_a"),
            Wire(((234, 92), (286, 92)), arrow=False),
            Text(258, 82, "T_m"),
            Box(286, 56, 78, 72, ("rotor", "J_m, B_m", "T_f(ω_m)")),
            Text(325, 44, "ω_m, θ_m"),
            Wire(((364, 92), (380, 92)), arrow=False),
            Wire(((380, 74), (380, 110)), arrow=False),
            _spring(380, 74),
            Text(413, 52, "K_s"),
            Wire(((380, 110), (404, 110)), arrow=False),
            Wire(((428, 100), (404, 100), (404, 120), (428, 120)), arrow=False),
            Wire(((416, 103), (416, 117)), arrow=False),
            Wire(((416, 110), (446, 110)), arrow=False),
            Text(413, 138, "B_s"),
            Wire(((446, 74), (446, 110)), arrow=False),
            Wire(((446, 92), (472, 92)), arrow=False),
            Text(413, 160, "T_s"),
            Box(472, 56, 78, 72, ("load", "J_L, B_L", "T_f(ω_L)")),
            Text(511, 44, "ω_L, θ_L"),
            Wire(((612, 92), (550, 92))),
            Text(588, 82, "T_d"),
        ),
    )


def block_diagram() -> Diagram:
    """Figure 4.3: the equations (4.1) to (4.11) as blocks."""
    return Diagram(
        "block-diagram",
        "Blocks of the motor (Figure 4.3). The dead zone D (4.9) acts on the voltage; the frictions T_f (4.7) act "
        "inside the loops.",
        950,
        214,
        (*_forward(), *_feedback()),
    )


def _forward() -> tuple[Shape, ...]:
    """From the voltage to the speed of the load."""
    return (
        Text(18, 82, "v_a"),
        Wire(((32, 86), (50, 86))),
        Box(50, 66, 54, 40, ("D(v)", "(4.9)")),
        Wire(((104, 86), (124, 86))),
        Circle(134, 86, 10, "Σ"),
        Wire(((144, 86), (160, 86))),
        Box(160, 66, 116, 40, ("1/(L_a·s + R_a)",)),
        Text(291, 78, "i_a"),
        Wire(((276, 86), (306, 86))),
        Box(306, 66, 40, 40, ("K_m",)),
        Text(362, 78, "T_m"),
        Wire(((346, 86), (376, 86))),
        Circle(386, 86, 10, "Σ"),
        Wire(((396, 86), (412, 86))),
        Box(412, 66, 120, 40, ("1/(J_m·s + B_m)",)),
        Text(552, 78, "ω_m"),
        Wire(((532, 86), (592, 86))),
        Circle(602, 86, 10, "Σ"),
        Wire(((612, 86), (628, 86))),
        Box(628, 66, 88, 40, ("B_s + K_s/s",)),
        Text(731, 78, "T_s"),
        Wire(((716, 86), (748, 86))),
        Circle(758, 86, 10, "Σ"),
        Wire(((768, 86), (784, 86))),
        Box(784, 66, 112, 40, ("1/(J_L·s + B_L)",)),
        Wire(((896, 86), (946, 86))),
        Text(932, 78, "ω_L"),
    )


def _feedback() -> tuple[Shape, ...]:
    """Back electromotive force, frictions, torque of the shaft, speed of the load, disturbance."""
    return (
        # feedback through the back electromotive force
        Wire(((574, 86), (574, 190), (346, 190))),
        Box(306, 172, 40, 36, ("K_m",)),
        Wire(((306, 190), (134, 190), (134, 96))),
        Text(122, 112, "−"),
        Text(220, 182, "e_a"),
        # friction of the rotor
        Wire(((556, 86), (556, 136), (508, 136))),
        Box(436, 120, 72, 32, ("T_f(ω_m)",)),
        Wire(((436, 136), (386, 136), (386, 96))),
        Text(374, 112, "−"),
        # torque of the shaft on the rotor
        Wire(((732, 86), (732, 22), (386, 22), (386, 76))),
        Text(374, 68, "−"),
        # speed of the load back to the shaft
        Wire(((920, 86), (920, 172), (602, 172), (602, 96))),
        Text(590, 112, "−"),
        # friction of the load and disturbance
        Wire(((906, 86), (906, 136), (876, 136))),
        Box(804, 120, 72, 32, ("T_f(ω_L)",)),
        Wire(((804, 136), (758, 136), (758, 96))),
        Text(746, 112, "−"),
        Wire(((758, 46), (758, 76))),
        Text(758, 40, "T_d"),
        Text(770, 68, "−"),
    )


def experimental_setup() -> Diagram:
    """Figure 5.4: the bench, as the virtual one has it."""
    return Diagram(
        "experimental-setup",
        "The bench (Figure 5.4): two generators, whose sum drives the motor; a tachogenerator on the shaft of the "
        "load; a converter that samples input and speed.",
        640,
        176,
        (
            Box(4, 14, 112, 34, ("sine generator 1",)),
            Box(4, 72, 112, 34, ("sine generator 2",)),
            Wire(((116, 31), (142, 31), (142, 50))),
            Wire(((116, 89), (142, 89), (142, 70))),
            Circle(142, 60, 10, "Σ"),
            Wire(((152, 60), (184, 60))),
            Box(184, 40, 84, 40, ("amplifier", "±15 V")),
            Wire(((268, 60), (316, 60))),
            Text(290, 52, "v_a"),
            Circle(340, 60, 24, "motor"),
            Wire(((364, 60), (408, 60)), arrow=False),
            Text(386, 52, "shaft"),
            Box(408, 36, 60, 48, ("load", "J_L")),
            Wire(((468, 60), (512, 60)), arrow=False),
            Box(512, 40, 112, 40, ("tachogenerator",)),
            Wire(((568, 80), (568, 142), (430, 142))),
            Text(590, 118, "ω_L"),
            Wire(((292, 60), (292, 142), (318, 142))),
            Box(318, 122, 112, 40, ("A/D converter", "12 bit")),
            Wire(((318, 154), (206, 154))),
            Box(94, 134, 112, 36, ("record: u(t), y(t)",)),
        ),
    )
