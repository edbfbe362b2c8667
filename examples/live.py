"""Live use: one update per sample and per epoch, a save in the middle, the same bits as the batch run.

python examples/live.py
"""

import numpy as np

import levelhead as lh

log, truth = lh.simulate("windrower", seed=2, duration=300)
velocity = truth.velocity_ned[::10]  # a receiver that says 10 Hz NED velocity
log = lh.Log(time=log.time, gyro=log.gyro, accel=log.accel, gnss_time=log.time[::10], velocity_ned=velocity)

observer = lh.Observer(lh.ObserverParams(tau=4.0))
for k, t in enumerate(log.time):
    observer.update_imu(t, log.gyro[k], log.accel[k])
    if k % 10 == 0:
        observer.update_gnss(t, velocity[k // 10])
    if k == log.time.size // 2:
        blob = observer.save()  # bytes for flash or disk: go on from here after a restart
        observer = lh.Observer.restore(blob)
    if k % 6000 == 0 and k > 0:
        gyro, accel = np.degrees(observer.gyro_bias).round(3), observer.accel_bias.round(3)
        print(f"{t:5.0f} s  gyro {gyro} deg/s  accel {accel} m/s^2  {observer.status!r}")

batch = lh.estimate(log, params=lh.ObserverParams(tau=4.0))
print("same bits as the batch run:", np.array_equal(observer.gyro_bias, batch.gyro_bias[-1]))
