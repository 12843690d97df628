"""Kinds of problems: how the page groups them, which it shows, and why other engines win some."""
import collections

Kind = collections.namedtuple('Kind', 'name title text shown scenes')
KINDS = (
    Kind('smooth', 'Smooth motion',
         'Pendulums, chains of rods, spinning bodies and springs: no loop of joints, no contact, no limit.',
         ('double_pendulum', 'chain_10', 'top'), ('double_pendulum', 'top')),
    Kind('loops', 'Loops and heavy loads',
         'Linkages that close, nets with redundant rods, and chains whose load weighs 1e3 to 1e6 times a link.',
         ('four_bar_10', 'net_8', 'heavy_chain_1e3'), ('four_bar_10', 'net_8')),
    Kind('mechanisms', 'Joints and couplings',
         'Two boxes on each kind of joint (hinge, slider, universal, ...) and coupling (gear, rack, screw, pulley), '
         'and chains of hinges.',
         ('hinge_pair', 'gear_pair', 'point_on_plane_pair'), ('gear_pair', 'hinge_four_bar')),
    Kind('robots', 'Robots', 'An arm with seven hinges and a quadruped with twelve.',
         ('arm_7', 'quadruped'), ('arm_7', 'quadruped')),
    Kind('events', 'Events',
         'Ropes that become taut, stops, dry friction, motors at their force limit, joints that break, and few '
         'contacts.',
         ('rope_and_wall', 'stick_slip', 'rocking_block'), ('ball_on_arm', 'rocking_block')),
    Kind('contacts', 'Contacts',
         'Balls and blocks that slide, roll, bounce and hit each other; heaps of 666 balls.',
         ('sliding_ball', 'block_slides', 'bouncing'), ('cradle', 'balls_666')),
)
MECHANISMS = 'mechanism'
ROBOTS = ('arm_7', 'quadruped')
LOOPS = ('four_bar', 'n_four_bar', 'ring', 'net')
CONTACT_HEAPS = ('balls_666',)  # events are too many to be found one by one


def kind_of(name, group):
    """Returns the name of the kind of a graded problem, from its name and its group in bench/report/problems."""
    if group == MECHANISMS:
        return 'robots' if name in ROBOTS else 'mechanisms'
    if group == 'stiff' or name.startswith(LOOPS):
        return 'loops'
    return {'event': 'events', 'contact': 'contacts'}.get(group, 'smooth')


# Why another engine is faster in problems of a kind; `problems` is None for all others of the kind.
Reason = collections.namedtuple('Reason', 'text kind problems')
REASONS = (
    Reason('The longest time step, 0.2 s, is within this error for the other engine, and costs less than our cheapest run, '
           'which errs by 2e-8 or less.', 'smooth', ('free_box_simple', 'pendula_1000')),
    Reason('Nothing moves. ODE keeps that within 1e-9 m with steps of 0.2 s, and our step costs more.',
           'contacts', ('block_sticks',)),
    Reason('Accelerations are constant, so that one step of any method is exact. Only the cost of a step counts, '
           "and MuJoCo's step costs less than ours.",
           'mechanisms', ('slider_pair',)),
    Reason('MuJoCo integrates the coordinates of the joints, and its step of order 4 costs less than ours of order 5 '
           'or 8. From 1e-6 on it needs so many steps that ours is faster.', 'mechanisms', None),
    Reason('A coarse error lets a step pass over the event. Steps of ODE and MuJoCo then cost less than ours, which '
           'look for the time of the event. From 1e-4 on they need hundreds of times as many steps.', 'events', None),
    Reason('Contacts of first order: at a coarse error the cost of a step decides.', 'contacts', None),
)


def reason_of(name, kind):
    """Returns why another engine wins a problem; empty where nobody has looked into it."""
    for reason in REASONS:
        if reason.kind == kind and (reason.problems is None or name in reason.problems):
            return reason.text
    return ''
