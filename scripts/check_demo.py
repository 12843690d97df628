#!/usr/bin/env python3
"""Checks the record of the demonstration; exits with 1 and a reason when it shows too little.

  check_demo.py BAG PICTURE BODY CONSTRAINT

BAG must hold every main topic, moving transforms, and the body and constraint added by
service calls. PICTURE is a screenshot of rviz whose 3-D view shows the colours of the markers.
"""
import subprocess
import sys

import numpy
import rosbag

TOPICS = ['/tf'] + ['/constraint_sim/' + name for name in
                    ('markers', 'body_states', 'constraint_states', 'statistics')]
MOVED = 0.05  # least motion of some frame [m]

# 3-D view of config/constraint_sim.rviz in pixels, well inside its frame
VIEW = (slice(70, 760), slice(24, 850))
BACKGROUND = (48, 48, 48)
DYNAMIC_BODY = (69, 130, 181)
# Colours of constraints: without load, and with an error; in tension and in compression.
UNLOADED, LARGE_ERROR, TENSION, COMPRESSION = (51, 204, 51), (255, 71, 64), (26, 217, 255), (255, 230, 26)


def check_bag(path, body, constraint):
    problems = []
    frames, constraints = {}, set()
    with rosbag.Bag(path) as bag:
        counts = bag.get_type_and_topic_info().topics
        for topic in TOPICS:
            if topic not in counts:
                problems.append(f'the bag has nothing on {topic}')
        for _, message, _ in bag.read_messages('/tf'):
            for transform in message.transforms:
                t = transform.transform.translation
                frames.setdefault(transform.child_frame_id, []).append((t.x, t.y, t.z))
        for _, message, _ in bag.read_messages('/constraint_sim/constraint_states'):
            constraints.update(state.name for state in message.constraints)
    travel = {frame: numpy.ptp(places, axis=0).max() for frame, places in frames.items()}
    if max(travel.values(), default=0.0) < MOVED:
        problems.append(f'no frame in /tf moved by {MOVED} m: {travel}')
    if body not in frames:
        problems.append(f'/tf lacks the added body {body}')
    if constraint not in constraints:
        problems.append(f'constraint_states lack the added constraint {constraint}')
    return problems


def read_view(path):
    """Returns the 3-D view as a float array of rows, columns, rgb."""
    size = subprocess.run(['identify', '-format', '%w %h', path], check=True, text=True,
                          stdout=subprocess.PIPE).stdout
    width, height = map(int, size.split())
    raw = subprocess.run(['convert', path, '-depth', '8', 'rgb:-'], check=True,
                         stdout=subprocess.PIPE).stdout
    return numpy.frombuffer(raw, numpy.uint8).reshape(height, width, 3)[VIEW].astype(float)


def count_close(pixels, colour, distance):
    return int((numpy.linalg.norm(pixels - colour, axis=-1) < distance).sum())


def count_shaded(pixels, colour):
    """Counts pixels of this colour under any light: equal direction in rgb, and not too dark."""
    brightness = numpy.linalg.norm(pixels, axis=-1)
    cosine = pixels @ (colour / numpy.linalg.norm(colour)) / numpy.maximum(brightness, 1.0)
    return int(((cosine > 0.995) & (brightness > 80)).sum())


def count_blended(pixels, start, end, distance):
    """Counts pixels close to the line between two colours."""
    start, way = numpy.array(start, float), numpy.subtract(end, start)
    share = numpy.clip((pixels - start) @ way / (way @ way), 0.0, 1.0)
    return count_close(pixels, start + share[..., None] * way, distance)


def check_picture(path):
    view = read_view(path)
    seen = {
        'background': (count_close(view, BACKGROUND, 6), 100_000),
        'dynamic bodies': (count_shaded(view, DYNAMIC_BODY), 200),
        'constraints': (count_blended(view, UNLOADED, LARGE_ERROR, 25) + count_close(view, TENSION, 25) +
                        count_close(view, COMPRESSION, 25), 100),
    }
    print('pixels seen: ' + ', '.join(f'{count} {name}' for name, (count, _) in seen.items()))
    return [f'the picture has only {count} pixels of {name}, not {least}'
            for name, (count, least) in seen.items() if count < least]


def main(bag, picture, body, constraint):
    problems = check_bag(bag, body, constraint) + check_picture(picture)
    for problem in problems:
        print(f'check_demo: {problem}', file=sys.stderr)
    return 1 if problems else 0


if __name__ == '__main__':
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
