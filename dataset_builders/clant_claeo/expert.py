# SPDX-License-Identifier: Apache-2.0
"""Scripted demonstrations: joint trajectories that push, pull or slide one object."""


import mink
import mujoco
import numpy as np
from nico_tabletop.objects import CUBE_HALF_WIDTH
from nico_tabletop.robot import INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.scene import TABLE_HEIGHT, build_model
from nico_tabletop.simulation import CONTROL_HZ
from nico_tabletop.tasks import Action

DT = 0.02
CFG = dict(travel=0.065, lift=0.07, speed=0.16, oc=0.05, back=0.02, reachover=0.08, first=1.0)
VERB = {
    "push": dict(fingers=(1, 0.1, -0.3), palm=(0.0, 0, -1), z=0.03, gap=0.02, shift=(0, 0, 0)),
    "pull": dict(fingers=(1, 0.1, -1), palm=(-1, 0, -1), z=0.025, gap=0.02, shift=(0, 0, 0)),
    "slide": dict(fingers=(1, 0.3, -0.2), palm=(0, 1, 0), z=0.035, gap=0.02, shift=(-0.005, 0, 0)),
}


def _tips(model, side, s):
    body = model.body(f"{side}_palm_11")
    ends = []
    for g in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, model.geom_quat[g])
        ax = R.reshape(3, 3)[:, 2] * model.geom_size[g][1]
        ends += [model.geom_pos[g] + ax, model.geom_pos[g] - ax]
    ends.sort(key=lambda e: e[2] * s)
    return (ends[0] + ends[1]) / 2


def plan(action: Action, position, debug=False):
    model = build_model(())
    verb = action.verb.split("-")[0]
    cfg = VERB[verb] | CFG
    d = np.array([*action.direction, 0.0])
    right = d[1] > 0 if verb == "slide" else position[1] < cfg["reachover"]
    s = 1.0 if right else -1.0
    side = "right" if right else "left"
    tool = _tips(model, side, s)
    f = np.array(cfg["fingers"], float) * [1, s, 1]
    p = np.array(cfg["palm"], float) * [1, s, 1]
    f /= np.linalg.norm(f)
    p -= f * (f @ p)
    p /= np.linalg.norm(p)
    z = -s * f  # local z axis
    R = np.stack([np.cross(p, z), p, z], axis=1)
    body = side + "_palm_11"
    conf = mink.Configuration(model)
    lim = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, {n: np.deg2rad(60.0) for n in JOINT_NAMES}),
    ]
    q = np.clip(np.deg2rad(INITIAL_POSE_DEG), model.jnt_range[:, 0], model.jnt_range[:, 1])
    qadr = [model.joint(n).qposadr[0] for n in JOINT_NAMES]
    q0 = np.zeros(model.nq)
    q0[qadr] = q
    conf.update(q0)
    T = conf.get_transform_frame_to_world(body, "body")
    hand = T.apply(tool)
    goal = np.array([*position, TABLE_HEIGHT + cfg["z"]]) + np.array(cfg["shift"]) * [1, s, 1]
    start = goal - d * (CUBE_HALF_WIDTH + 0.009 + cfg["gap"])
    end = start + d * (cfg["gap"] + cfg["travel"])
    up = np.array([0, 0, cfg["lift"]])
    back = end - d * cfg["back"]
    pts = [hand, np.array([*hand[:2], (start + up)[2]]), start + up, start, end, back, back + up]
    orient = mink.FrameTask(body, "body", 0.0, cfg["oc"])
    where = mink.FrameTask(body, "body", 1.0, 0.0)
    orient.set_target(mink.SE3.from_rotation(mink.SO3.from_matrix(R)))
    rows = [INITIAL_POSE_DEG]
    errs = []
    sub = 0

    def track(point):
        nonlocal sub
        R_now = conf.get_transform_frame_to_world(body, "body").rotation()
        where.set_target(mink.SE3.from_translation(point - R_now.apply(tool)))
        v = mink.solve_ik(conf, [where, orient], DT, solver="daqp", damping=1e-4, limits=lim)
        conf.integrate_inplace(v, DT)
        errs.append(np.linalg.norm(conf.get_transform_frame_to_world(body, "body").apply(tool) - point))
        sub += 1
        if sub % round(1 / DT / CONTROL_HZ) == 0:
            rows.append(np.rad2deg(conf.q[qadr]))

    marks = []
    for i, (a, b) in enumerate(zip(pts, pts[1:])):
        sec = 1.5 * np.linalg.norm(b - a) / cfg["speed"]
        if i == 0:
            sec = max(sec, cfg["first"])
        n = int(np.ceil(sec / DT))
        for k in range(1, n + 1):
            t = k / n
            t = t * t * (3 - 2 * t)
            track(a + (b - a) * t)
        Rn = conf.get_transform_frame_to_world(body, "body").rotation().as_matrix()
        marks.append((len(rows), errs[-1], -s * Rn[:, 2], Rn[:, 1]))
    if debug:
        for mk in marks:
            print("  ", mk)
    rows += [rows[-1]] * max(0, 40 - len(rows))
    return np.array(rows)
