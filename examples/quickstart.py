"""First lines: a simulated drive, its biases, and a log with the biases taken off.

python examples/quickstart.py
"""

import numpy as np

import levelhead as lh

log, truth = lh.simulate("field", seed=1, duration=1800)
result = lh.estimate(log)

for name, estimate, exact, unit in (
    ("gyro", np.degrees(result.gyro_bias[-1]), np.degrees(truth.gyro_bias[-1]), "deg/s"),
    ("accel", result.accel_bias[-1], truth.accel_bias[-1], "m/s^2"),
):
    for axis in range(3):
        print(f"{name} {'xyz'[axis]}: {estimate[axis]:+.4f}, truth {exact[axis]:+.4f} {unit}")

print("known:", result.summary()["known"])
again = lh.estimate(log.corrected(result))
left = np.degrees(again.gyro_bias[-1, :2]), again.accel_bias[-1, :2]
print("left in the corrected log:", left[0].round(4), "deg/s,", left[1].round(4), "m/s^2")
