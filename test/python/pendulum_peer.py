#!/usr/bin/env python3
"""Another engine as a method of a study, for one body on a rod at rest: its angle by the equation of the
pendulum, by `tight` steps of a Runge-Kutta method of order 4 or by `euler` with one explicit step a tick. It
shares no code with constraint_sim; `crash` ends by a signal."""
import argparse
import math
import os
import signal

import yaml

VARIANTS = ('tight', 'euler', 'crash')


def runge_kutta(angle, rate, gain, step):
    def slope(a, r):
        return r, -gain * math.sin(a)
    a1, r1 = slope(angle, rate)
    a2, r2 = slope(angle + 0.5 * step * a1, rate + 0.5 * step * r1)
    a3, r3 = slope(angle + 0.5 * step * a2, rate + 0.5 * step * r2)
    a4, r4 = slope(angle + step * a3, rate + step * r3)
    return angle + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4), rate + step / 6 * (r1 + 2 * r2 + 2 * r3 + r4)


def euler(angle, rate, gain, step):
    return angle + step * rate, rate - step * gain * math.sin(angle)


def pendulum_of(scene):
    """Returns (gravity, length, angle from straight down), or the reason why the scene is no pendulum."""
    joints = scene.get('constraints', [])
    if len(scene['bodies']) != 1 or len(joints) != 1 or 'stiffness' in joints[0]:
        return 'scene: is not one body on a rod'
    x, _, z = scene['bodies'][0]['position']
    return -scene['world']['gravity'][2], math.hypot(x, z), math.atan2(x, -z)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('command')
    parser.add_argument('scene', nargs='?')
    for option in ('--variant', '--values', '--duration', '--sample', '--budget'):
        parser.add_argument(option)
    options = parser.parse_args()
    if options.command == 'list':
        print('\n'.join(f'{variant}\tjoint\ttick\tpendulum\t1.0\t' for variant in VARIANTS))
        return
    if options.variant == 'crash':
        os.kill(os.getpid(), signal.SIGABRT)
    with open(options.scene) as file:
        found = pendulum_of(yaml.safe_load(file))
    if isinstance(found, str):
        print('outcome unsupported 0 nan nan nan', found)
        return
    gravity, length, angle = found
    tick, sample, duration = float(options.values), float(options.sample), float(options.duration)
    step, method = (1e-3, runge_kutta) if options.variant == 'tight' else (tick, euler)
    print('outcome ok 0.001 0 0 0')
    rate = 0.0
    for number in range(round(duration / sample) + 1):
        s, c = math.sin(angle), math.cos(angle)
        print('state', number * sample, length * s, 0, -length * c, 0, 0, 0, 1, length * rate * c, 0,
              length * rate * s, 0, 0, 0)
        for _ in range(round(sample / step)):
            angle, rate = method(angle, rate, gravity / length, step)


if __name__ == '__main__':
    main()
