"""Random hands by the rotations of SciPy, with the angles that they were made from: tests/data/hand_reference.json.

    python3 tests/python/hand_reference.py tests/data/hand_reference.json
"""

import json
import sys

import numpy as np
from scipy.spatial.transform import Rotation

SEED = 17


def finger(rng, base, mcp, palm_back, angles):
    """MCP, PIP, DIP and tip of a right hand's finger; axes of a bone: x to the thumb, y to the back, z along it."""
    dip, pip, flexion, abduction = angles
    along = (mcp - base) / np.linalg.norm(mcp - base)
    radial = np.cross(palm_back, along)
    radial /= np.linalg.norm(radial)
    turn = Rotation.from_matrix(np.stack([radial, np.cross(along, radial), along], axis=1))
    points = [mcp]
    for step in (Rotation.from_euler("XY", [flexion, abduction]), Rotation.from_euler("X", pip), Rotation.from_euler("X", dip)):
        turn = turn * step
        points.append(points[-1] + turn.apply([0, 0, rng.uniform(0.015, 0.05)]))
    return points


def hand(rng, layout, side):
    """Points in the order of the layout, and the angles in the order of the joints."""
    wrist = np.zeros(3)
    knuckles = [np.array([x, 0.0, z]) + rng.normal(0, 0.003, 3) for x, z in ((0.03, 0.09), (0.01, 0.095), (-0.01, 0.09), (-0.03, 0.08))]
    back = np.cross(knuckles[3] - wrist, knuckles[0] - wrist)
    back /= np.linalg.norm(back)
    angles, fingers, bases = [], [], []
    for knuckle in knuckles:
        base = wrist if layout == "mano21" else 0.25 * knuckle + rng.normal(0, 0.003, 3)
        of_finger = [rng.uniform(-0.3, 1.4), rng.uniform(-0.3, 1.9), rng.uniform(-0.5, 1.6), rng.uniform(-0.5, 0.5)]
        bases.append(base)
        fingers.append(finger(rng, base, knuckle, back, of_finger))
        angles += of_finger
    ip, mcp, flexion, abduction = rng.uniform(0.05, 1.3), rng.uniform(0.05, 1.0), rng.uniform(-0.3, 1.2), rng.uniform(0.0, 1.2)
    angles += [ip, mcp, flexion, abduction]
    along = (knuckles[1] - wrist) / np.linalg.norm(knuckles[1] - wrist)
    radial = np.cross(back, along)
    radial /= np.linalg.norm(radial)
    turn = Rotation.from_matrix(np.stack([radial, np.cross(along, radial), along], axis=1))
    thumb = [np.array([0.02, -0.005, 0.02]) + rng.normal(0, 0.003, 3)]
    for step in (Rotation.from_euler("XY", [flexion, abduction]), Rotation.from_euler("Y", -mcp), Rotation.from_euler("Y", -ip)):
        turn = turn * step
        thumb.append(thumb[-1] + turn.apply([0, 0, rng.uniform(0.02, 0.045)]))
    if layout == "mano21":
        points = [wrist, *thumb, *(point for chain in fingers for point in chain)]
    else:
        points = [*([0.5 * knuckles[1]] if layout == "openxr" else []), wrist, *thumb]
        for base, chain in zip(bases, fingers):
            points += [base, *chain]
    points = np.array(points) * ([-1, 1, 1] if side == "left" else [1, 1, 1])
    moved = Rotation.random(random_state=rng).apply(points) + rng.normal(0, 1, 3)
    return moved.tolist(), [float(angle) for angle in angles]


def frames(rng, points):
    """The points as frames, each turned at random and told in the one before it on its finger: parent, translation, x y z w."""
    turns = Rotation.random(len(points), random_state=rng)
    told = []
    for k, point in enumerate(points):
        # The wrist, four points of the thumb, five of each finger.
        begins = k == 1 or (k >= 5 and k % 5 == 0)
        parent = None if k == 0 else 0 if begins else k - 1
        origin, turn = (np.zeros(3), Rotation.identity()) if parent is None else (np.array(points[parent]), turns[parent])
        translation = turn.inv().apply(np.array(point) - origin)
        told.append({"parent": parent, "translation": translation.tolist(), "rotation": (turn.inv() * turns[k]).as_quat().tolist()})
    return told


def main():
    rng = np.random.default_rng(SEED)
    hands = []
    for k in range(100):
        layout, side = ("openxr", "mano21")[k % 2], ("left", "right")[k // 2 % 2]
        points, angles = hand(rng, layout, side)
        hands.append({"layout": layout, "side": side, "points": points, "angles": angles})
    for k in range(20):
        layout, side = ("openxr25", "manus")[k % 2], ("left", "right")[k // 2 % 2]
        points, angles = hand(rng, layout, side)
        hands.append({"layout": layout, "side": side, "points": points, "angles": angles, "frames": frames(rng, points)})
    with open(sys.argv[1], "w") as out:
        out.write("[\n" + ",\n".join(json.dumps(hand) for hand in hands) + "\n]\n")


main()
