"""Results of the peers in an earlier comparison on another machine: µs of run time per simulated
second to a position error of 1e-2, 1e-4, 1e-6 (heavy_chain: of the load). None: not reached.

Its versions were ODE 0.16, Bullet 3.24, MuJoCo 3.12, Simbody 3.7 and an unknown DART; MuJoCo's column
for tendons is compared with the better of Euler and RK4. The report prints where the ratios between
peers differ.
"""
TARGETS = (1e-2, 1e-4, 1e-6)
TIMES = {
    'free_box': {'simbody': (2720, 8250, 22400), 'mujoco joint': (152, 1220, 9680)},
    'pendulum': {
        'ode': (103, None, None), 'bullet cartesian': (157, None, None),
        'mujoco tendon': (444, 66700, None), 'simbody rod': (2050, 3120, 7910),
        'mujoco joint': (51, 51, 101), 'bullet featherstone': (85, 85, 168),
        'simbody pin': (428, 900, 2360), 'dart': (192, None, None)},
    'double_pendulum': {
        'ode': (329, None, None), 'bullet cartesian': (643, None, None),
        'mujoco tendon': (1360, 44600, None), 'simbody rod': (1780, 3620, 12800),
        'mujoco joint': (78, 78, 303), 'bullet featherstone': (133, 133, 526),
        'simbody pin': (638, 1340, 2750), 'dart': (1670, None, None)},
    'chain_10': {
        'ode': (5490, None, None), 'bullet cartesian': (10000, None, None),
        'mujoco tendon': (24200, 503000, None), 'simbody rod': (8400, 19800, 49200),
        'mujoco joint': (324, 1320, 2630), 'bullet featherstone': (551, 2210, 4570),
        'simbody pin': (1910, 4410, 14000), 'dart': (108000, None, None)},
    'chain_100': {
        'ode': (63100, None, None), 'bullet cartesian': (119000, None, None),
        'mujoco tendon': (45000, 799000, None), 'simbody rod': (310000, 1.15e6, None),
        'mujoco joint': (10000, 42700, 86000), 'bullet featherstone': (4640, 20800, 46800),
        'simbody pin': (8500, 26500, 68000), 'dart': (189000, None, None)},
    'heavy_chain_1e3': {
        'ode': (1360, 1360, 11300), 'bullet cartesian': (3250, 3250, 27000),
        'mujoco tendon': (6260, 55900, None), 'simbody rod': (63400, 175000, 453000),
        'mujoco joint': (1590, 2880, 11900), 'bullet featherstone': (2570, None, 19100),
        'simbody pin': (8420, 17700, 37300), 'dart': (5210, 11700, None)},
    'heavy_chain_1e6': {
        'ode': (28700, 28700, 28700), 'bullet cartesian': (63600, 63600, 63600),
        'mujoco joint': (33200, 33200, 120000), 'bullet featherstone': (51900, 51900, 195000),
        'simbody pin': (178000, 178000, 776000), 'dart': (118000, 118000, None)},
}


def column(contestant):
    """Returns the column of the table above for a contestant; None without one."""
    engine, variant = contestant.split()[:2]
    if engine in ('ode', 'dart'):
        return engine
    if engine == 'mujoco':
        return 'mujoco joint' if variant.startswith('joint') else 'mujoco tendon'
    if engine == 'bullet':
        return 'bullet featherstone' if variant.startswith('featherstone') else 'bullet cartesian'
    if engine == 'simbody':
        return f'simbody {variant}'
    return None


# Known reasons of differences, by peer; the earlier comparison tried no tick above 1/30 s.
REASONS = {
    'mujoco tendon': 'MuJoCo 2.2.2 here, 3.12 there; how stiff tendons are set decides the error',
    'mujoco joint': 'MuJoCo 2.2.2 here, 3.12 there',
    'dart': "Debian's DART has its assertions on",
    'bullet cartesian': 'a rod of one row written for this report',
}
OTHER_STEPS = 'the steps that were tried differ, and so which is the first below the error'
COARSE = 'reached at a tick of 1/10 or 1/20 s, and nothing above 1/30 s was tried then'
EXACT = 'the loosest accuracy that was tried here, 0.1, is a hundred times as exact as asked'


def reason(problem, column, target, then, now):
    """Returns the reason why a figure differs, or is missing in one comparison (None)."""
    if now is None:
        return 'not reached here within the budget'
    if then is None:
        return 'not reached then, with ticks down to 1/10 000 s'
    if problem == 'pendulum' and column in ('mujoco joint', 'bullet featherstone') and now < then:
        return COARSE
    if (problem, column, target) == ('heavy_chain_1e3', 'simbody pin', 1e-2):
        return EXACT
    return REASONS.get(column, OTHER_STEPS)
