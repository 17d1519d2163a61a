"""Two balls on a spring: generate clips, learn, predict."""

import paig

clips = paig.generate("spring_color", train=1000, valid=100, test=100, out="spring/data")
run = paig.train(clips, out="spring/run", seed=0)
k, l = run.parameters["k"], run.parameters["l"]
print(f"k = {k} (true {k.truth}), half the rest length = {l} (true {l.truth})")
print(run.verdict)

prediction = run.predict(60, clip=0)
print("positions 60 frames after the input, px:", prediction.positions[-1].tolist())
