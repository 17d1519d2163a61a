"""Your own video: parameters in metres and seconds, with 95 % intervals.

    python own_video.py clip.mp4
"""

import sys

import paig

drag = paig.Equation(
    "vec(0, g) - c * norm(v) * v", parameters={"g": {"unit": (1, -2)}, "c": {"unit": (-1, 0), "start": 0.01}})
# From (102, 74) to (145, 1636) in the picture are 2.28 metres.
scene = paig.import_video(sys.argv[1], "scene", equation="falling", scale=(102, 74, 145, 1636, 2.28), scale_percent=0.5)
print("\n".join(scene.warnings))
run = paig.train(scene, out="scene-run")
measured = run.measure(against=[drag])
print(measured.parameters)
for alternative in measured.alternatives():
    print(alternative["equation"], alternative["held_out_error"])
