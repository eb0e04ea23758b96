"""The paper's case: joints 2, 4 and 5 lock while the arm pushes with (80, 50, 10) N."""

import ftforce

arm = ftforce.load_robot("dh5")
result = ftforce.analyze(arm, posture="paper", locked=[2, 4, 5], force=[80, 50, 10])

print("verdict    ", result.verdict.value)
print("force jump ", f"{result.force.jump_norm:.2f} N")
print("F after    ", result.force.after.round(2), "N, tool axes")
for joint, torque in zip(arm.joints, result.torque.after, strict=True):
    print(f"{joint.name}      {torque:7.2f} {joint.torque_unit}")
print("proved     ", result.is_proved())
