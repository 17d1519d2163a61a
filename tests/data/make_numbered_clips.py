"""Makes numbered.mp4 and numbered_hevc.mp4: 60 and 4 frames that show their own number. Needs PyAV 18 (pip install av numpy).

A frame has 64 x 48 pixels. Its upper half holds six blocks of 10 x 24 pixels, white for a 1 and black for a 0 of the
frame's number in binary, the highest digit first; the lower half holds a grey square that moves to the right by one
pixel a frame, and back from frame 36 on. numbered.mp4 is H.264 with three B-frames in a row, 25 frames a second; its
description stands before the frames.
"""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

FOLDER = Path(__file__).parent
FRAMES = 60


def picture(number):
    frame = np.full((48, 64, 3), 16, np.uint8)
    for place in range(6):
        level = 235 if number >> (5 - place) & 1 else 16
        frame[:24, 2 + 10 * place : 12 + 10 * place] = level
    left = 4 + min(number, 72 - number)
    frame[30:42, left : left + 12] = 160
    return frame


def write(name, codec, options, frames):
    with av.open(str(FOLDER / name), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.options = options
        stream.codec_context.time_base = Fraction(1, 25)
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


write("numbered.mp4", "libx264", {"bf": "3", "g": "16", "crf": "18", "b_strategy": "0", "sc_threshold": "0"}, FRAMES)
write("numbered_hevc.mp4", "libx265", {"crf": "30", "x265-params": "log-level=none"}, 4)
