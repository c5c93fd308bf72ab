"""An arm of two joints with a gripper of two fingers, one of which mimics the other."""

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = (
    '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="{}" upper="{}" effort="50" velocity="3"/>{}</joint>'
)
MIMIC = '<mimic joint="left" multiplier="-1"/>'
ARM = "".join(
    (
        '<robot name="handy"><link name="base"/>',
        *(f'<link name="{name}">{INERTIAL.format(mass)}</link>' for name, mass in (("upper", 3), ("lower", 2))),
        *(f'<link name="{name}">{INERTIAL.format(0.05)}</link>' for name in ("finger1", "finger2")),
        JOINT.format("shoulder", "revolute", "base", "upper", 0, -2, 2, ""),
        JOINT.format("elbow", "revolute", "upper", "lower", 0.4, -2, 2, ""),
        JOINT.format("left", "prismatic", "lower", "finger1", 0.3, 0.0, 0.04, ""),
        JOINT.format(
            "right", "prismatic", "lower", "finger2", 0.3, -0.04, 0.0, '<mimic joint="left" multiplier="-1"/>'
        ),
        "</robot>",
    )
)
