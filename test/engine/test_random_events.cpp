// shards: 2
// Random event-driven scenes of few bodies, with all findings (bench/random_events.h,
// judge_events.h). constraint_sim_random_events does so with any number of scenes.

#include <initializer_list>
#include <map>
#include <optional>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "event_costs.h"
#include "judge_events.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine::random_events {
namespace {

const unsigned kScenes = 300 / kSeedShare;

struct Found {
  unsigned given_up = 0, left = 0, events = 0;
};

void expect_none(const Scene& scene, const Verdict& verdict) {
  for (const std::string& finding : verdict.findings)
    ADD_FAILURE() << "--kind " << static_cast<int>(scene.kind) << " --seed " << scene.seed << ": "
                  << finding;
}

Found hold(Kind kind, unsigned scenes) {
  Found found;
  for (unsigned seed = 0; seed < scenes; ++seed) {
    const Scene scene = scene_of(kind, seed);
    Verdict verdict;
    follow(scene, &verdict);
    expect_none(scene, verdict);
    found.given_up += verdict.is_given_up;
    found.left += verdict.is_left;
    found.events += verdict.events;
  }
  return found;
}

TEST(RandomEvents, OfMechanismsGainNoEnergy) {
  const Found found = hold(Kind::kMechanism, kScenes * 2 / 3);
  EXPECT_LE(found.given_up + found.left, 1 + kScenes / 150);
  EXPECT_GT(found.events, 7 * kScenes);
}

TEST(RandomEvents, OfMechanismsWithMotorsGainWhatTheseDo) {
  const Found found = hold(Kind::kMechanismWithMotors, kScenes / 3);
  EXPECT_LE(found.given_up + found.left, 1 + kScenes / 150);
  EXPECT_GT(found.events, 3 * kScenes);
}

// The engine gives up and reports some scenes: 3, 3 and 12 of 300 each. Where boxes meet boxes, and
// joints pull shapes into each other, contacts are left to impulses.
TEST(RandomEvents, OfContactsGainNoEnergyAndOverlapNowhere) {
  const Found found = hold(Kind::kTouching, kScenes);
  EXPECT_LE(found.given_up, 1 + kScenes / 60);
  EXPECT_LE(found.left, 1 + kScenes / 6);
  EXPECT_GT(found.events, 5 * kScenes);
}

TEST(RandomEvents, OfContactsWithLawsGainNoEnergy) {
  const Found found = hold(Kind::kTouchingWithLaws, kScenes);
  EXPECT_LE(found.given_up, 1 + kScenes / 60);
  EXPECT_LE(found.left, 1 + kScenes / 6);
  EXPECT_GT(found.events, 5 * kScenes);
}

// Two groups that are given up in a step after one in which impulses corrected positions: the
// velocities that did so are not those of the bodies.
TEST(RandomEvents, OfGroupsThatAreGivenUpAfterACorrectionGainNoEnergy) {
  for (const unsigned seed : {57u, 65u}) {
    const Scene scene = scene_of(Kind::kAligned, seed);
    Verdict verdict;
    follow(scene, &verdict);
    expect_none(scene, verdict);
    EXPECT_TRUE(verdict.is_given_up) << seed;
  }
}

// A group that is given up is handed over once, and keeps its reason.
TEST(RandomEvents, OfGroupsThatAreGivenUpAreHandedOverOnce) {
  for (const unsigned seed : {57u, 65u}) {
    World world = world_of(scene_of(Kind::kAligned, seed));
    while (!has_given_up(world)) ASSERT_LT(world.step().time, 10.0) << seed;
    EXPECT_GT(world.report().contacts.handed_over, 0u) << seed;
    for (int i = 0; i < 5; ++i) {
      EXPECT_EQ(world.step().contacts.handed_over, 0u) << seed << " " << i;
      EXPECT_TRUE(has_given_up(world)) << seed << " " << i;
    }
  }
}

// Shapes have random poses in their bodies: as many scenes are given up, and left to impulses, as
// above.
TEST(RandomEvents, OfContactsWithPosesGainNoEnergy) {
  const Found found = hold(Kind::kTouchingWithPoses, kScenes / 2);
  EXPECT_LE(found.given_up, 1 + kScenes / 30);
  EXPECT_LE(found.left, 1 + kScenes / 12);
  EXPECT_GT(found.events, 5 * kScenes / 2);
}

// Bodies of two shapes meet more often, and are given up alike: 24 of 600, and 34 are left.
TEST(RandomEvents, OfContactsWithPartsGainNoEnergy) {
  const Found found = hold(Kind::kTouchingWithParts, kScenes / 2);
  EXPECT_LE(found.given_up, 1 + kScenes / 30);
  EXPECT_LE(found.left, 1 + kScenes / 12);
  EXPECT_GT(found.events, 5 * kScenes / 2);
}

// Screws, gears, racks and pulleys beside contacts: 16 of 400 are given up, and 18 left.
TEST(RandomEvents, OfContactsWithCouplingsGainNoEnergy) {
  const Found found = hold(Kind::kTouchingCoupled, kScenes / 2);
  EXPECT_LE(found.given_up, 1 + kScenes / 30);
  EXPECT_LE(found.left, 1 + kScenes / 12);
  EXPECT_GT(found.events, 5 * kScenes / 2);
}

// Joints that are open, and motors to positions, beside contacts: 12 of 400 are given up, and 18
// left. The others meet, and move alike in finer steps up to the first hits.
TEST(RandomEvents, OfOpenJointsBesideContactsClose) {
  Found found;
  unsigned compared = 0;
  for (unsigned seed = 0; seed < kScenes / 3; ++seed) {
    const Scene scene = scene_of(Kind::kTouchingOpen, seed);
    Verdict verdict;
    follow_closing(scene, &verdict);
    compared += step_finer(scene, &verdict);
    expect_none(scene, verdict);
    found.given_up += verdict.is_given_up;
    found.left += verdict.is_left;
  }
  EXPECT_LE(found.given_up, 1 + kScenes / 30);
  EXPECT_LE(found.left, 1 + kScenes / 12);
  EXPECT_GT(compared, kScenes / 4);
}

TEST(RandomEvents, OfContactsWithMotorsGainWhatTheseDo) {
  EXPECT_LE(hold(Kind::kTouchingWithMotors, kScenes / 2).given_up, 1 + kScenes / 15);
}

TEST(RandomEvents, WithServosGainWhatThesePush) {
  const Found mechanisms = hold(Kind::kMechanismWithServos, kScenes / 2);
  EXPECT_LE(mechanisms.given_up + mechanisms.left, 1 + kScenes / 150);
  EXPECT_GT(mechanisms.events, 3 * kScenes);
  EXPECT_LE(hold(Kind::kTouchingWithServos, kScenes / 2).given_up, 1 + kScenes / 15);
}

// Arms of 1 to 10 links with stops, friction, springs and weak motors: of seeds 0 to 2999 none is
// given up.
TEST(RandomEvents, OfArmsAreFollowed) {
  const Found found = hold(Kind::kArm, kScenes);
  EXPECT_LE(found.given_up + found.left, kScenes / 100);
  EXPECT_GT(found.events, 30 * kScenes);
}

// Arms move alike with a thousandth and with a thousand times the mass, and in finer steps.
TEST(RandomEvents, OfArmsDependNeitherOnMassNorOnTimeStep) {
  unsigned compared = 0;
  for (unsigned seed = 0; seed < kScenes / 3; ++seed) {
    const Scene scene = scene_of(Kind::kArm, seed);
    Verdict verdict;
    weigh_otherwise(scene, &verdict);
    compared += step_finer(scene, &verdict);
    expect_none(scene, verdict);
  }
  EXPECT_GT(compared, kScenes / 4);
}

// Within one step of these seeds the load of a joint exceeds what it bears, or a force exceeds
// friction, and falls again.
TEST(RandomEvents, BetweenTheEndsOfAStepAreNotMissed) {
  for (const auto& [kind, seed] : {std::pair(Kind::kMechanismWithServos, 901U),
                                   std::pair(Kind::kArm, 672U), std::pair(Kind::kArm, 1272U)}) {
    const Scene scene = scene_of(kind, seed);
    Verdict verdict;
    EXPECT_TRUE(step_finer(scene, &verdict)) << seed;
    expect_none(scene, verdict);
  }
}

/// Expects that these scenes are followed to their end, and have more than two events, or ten
/// with aligned boxes. Returns the dearest tick of any, over the median tick of its scene.
double follow_to_the_end(Kind kind, std::initializer_list<unsigned> seeds) {
  double worst_tick = 0.0;
  for (const unsigned seed : seeds) {
    const Scene scene = scene_of(kind, seed);
    Verdict verdict;
    follow(scene, &verdict);
    expect_none(scene, verdict);
    EXPECT_FALSE(verdict.is_given_up || verdict.is_left) << seed;
    EXPECT_GT(verdict.events, kind == Kind::kAligned ? 10u : 2u) << seed;
    worst_tick = std::max(worst_tick, verdict.worst_tick);
  }
  return worst_tick;
}

// Seeds of motors with friction that start from rest; of friction or a limit that holds a
// coordinate at a rate within 1e-9 of that of a motor; and of motors that brake to their position
// with a deceleration of 1e3, which rounding of the position must not hide.
TEST(RandomEvents, OfArmsWithNearJumpsAreNotGivenUp) {
  follow_to_the_end(Kind::kArm, {4U, 39U, 65U, 191U, 85U, 199U, 28U, 42U, 51U, 79U, 1602U});
}

// Seeds of motors that are kicked, or become too weak, where they rest at their position.
TEST(RandomEvents, OfArmsWithMotorsAtTheirPositionAreNotGivenUp) {
  follow_to_the_end(Kind::kArm, {118U, 182U, 404U, 783U, 978U});
}

// Seeds of two limits that hit in turn without end, each of which throws the other one off: at
// 1e-7 rad/s, and at 1e-6 rad/s with an acceleration of 1e3 rad/s², lower than the rounding of
// positions.
TEST(RandomEvents, OfArmsWithLimitsThatRattleComeToRest) {
  follow_to_the_end(Kind::kArm, {119U, 338U, 398U, 575U, 962U});
}

// Seeds of motors that come to rest at their position within a substep, at a kink that no substep
// may be shortened for.
TEST(RandomEvents, OfArmsWithMotorsThatBrakeCostFewSubsteps) {
  EXPECT_LT(follow_to_the_end(Kind::kArm, {361U, 567U}), 200.0);
}

// Seeds whose dearest ticks have up to 550 events, as bounces between friction and a stop, and cost
// up to 450 times the median tick where each event takes full substeps.
TEST(RandomEvents, OfArmsWithManyEventsInATickCostFewEvaluations) {
  EXPECT_LT(follow_to_the_end(Kind::kArm, {4U, 519U, 588U, 2386U, 2706U, 2979U}), 200.0);
}

// Seed of a motor to a position that becomes too weak while it holds the position: the direction of
// its force must not be that of the rounding of the position.
TEST(RandomEvents, OfAMotorThatBecomesTooWeakAtItsPositionIsTheSameElsewhere) {
  const Scene scene = scene_of(Kind::kMechanismWithServos, 2148);
  Verdict verdict;
  EXPECT_TRUE(place_elsewhere(scene, &verdict));
  expect_none(scene, verdict);
}

// Seeds where corners that share a load reach the cone shortly after each other and regain friction
// in turn, where a slip with ever faster rotation ends, and where a corner 1e-11 m within another
// box rises and falls back; none of these may exhaust the work of a step.
TEST(RandomEvents, OfAlignedBoxesThatBeginToSlipOrEndAreNotGivenUp) {
  follow_to_the_end(Kind::kAligned, {19U, 34U, 3U, 84U, 86U, 90U});
}

// Seeds where corners rattle ever lower, or at 1e-8 m/s without end; where slips turn at their end
// again and again; where a force at its bound is less certain than its tolerance, so that its event
// comes again and changes nothing; and where rounding hides an impact at 1e-9 m/s.
TEST(RandomEvents, OfAlignedBoxesThatRattleComeToRest) {
  follow_to_the_end(Kind::kAligned, {22U, 40U, 108U, 118U, 256U, 280U});
}

// Seeds of a box that tilts on an edge: the redundant rows of its two corners must stay redundant
// where positions are corrected by less than their last bit.
TEST(RandomEvents, OfAlignedBoxesOnAnEdgeAreNotGivenUp) {
  follow_to_the_end(Kind::kAligned, {0U, 88U});
}

// Seeds where margins of features begin at zero to rounding, without an event. They must not hide
// other events of the substep, which let a box enter the floor or gain 1.5 mJ.
TEST(RandomEvents, OfAlignedBoxesAreNeverLate) {
  for (const unsigned seed : {12U, 26U, 35U}) {
    const Scene scene = scene_of(Kind::kAligned, seed);
    Verdict verdict;
    follow(scene, &verdict);
    expect_none(scene, verdict);
    EXPECT_GT(verdict.events, 10u) << seed;
  }
}

// Seed of a slip that ends within a substep: a box in a ball joint whose corner slides on the floor
// must not gain energy.
TEST(RandomEvents, OfASlipThatEndsGainNoEnergy) {
  const Scene scene = scene_of(Kind::kTouching, 312);
  Verdict verdict;
  follow(scene, &verdict);
  expect_none(scene, verdict);
  EXPECT_FALSE(verdict.is_given_up || verdict.is_left);
}

// Joints and friction can lock a body against the floor, where impulses of any size have no effect:
// their size must be that of the motion, or their rounding (at 1e16 N s) becomes the motion.
TEST(RandomEvents, ThatLockHaveImpulsesOfTheMotion) {
  for (const auto& [kind, seed] :
       {std::pair(Kind::kTouching, 146U), std::pair(Kind::kTouchingWithLaws, 53U)}) {
    const Scene scene = scene_of(kind, seed);
    Verdict verdict;
    EXPECT_TRUE(place_elsewhere(scene, &verdict)) << seed;
    expect_none(scene, verdict);
    // no impulse exceeds that which stops all bodies at 100 m/s
    World world = world_of(scene);
    while (world.time() < 1.0) {
      world.step();
      for (const Event& event : world.events()) EXPECT_LT(event.impulse, 10.0 * scene.largest);
    }
  }
}

TEST(RandomEvents, AreTheSameCopiedInSnapshotsAndWithThreads) {
  for (std::size_t k = 0; k < kKindNames.size(); ++k)
    for (unsigned seed = 0; seed < kScenes / 8; ++seed) {
      const Scene scene = scene_of(static_cast<Kind>(k), seed);
      Verdict verdict;
      repeat(scene, &verdict);
      expect_none(scene, verdict);
    }
}

TEST(RandomEvents, DoNotDependOnPlaceAndOrder) {
  unsigned compared = 0;
  for (std::size_t k = 0; k < kKindNames.size(); ++k)
    for (unsigned seed = 0; seed < kScenes / 8; ++seed) {
      const Scene scene = scene_of(static_cast<Kind>(k), seed);
      Verdict verdict;
      compared += place_elsewhere(scene, &verdict);
      expect_none(scene, verdict);
    }
  EXPECT_GT(compared, kScenes / 4);
}

// A scene saved and loaded continues as when it is loaded again, and as the original within the
// tolerance, since substeps restart.
TEST(RandomEvents, GoOnWhenSavedAndLoaded) {
  for (unsigned seed = 0; seed < kScenes / 6; ++seed) {
    World world = world_of(scene_of(Kind::kMechanismWithMotors, seed));
    run(world, 20);
    const std::string text = save_scene(world);
    World again = load_scene(text), twice = load_scene(text);
    ASSERT_EQ(save_scene(again), text) << seed;
    for (int i = 0; i < 12; ++i) {
      for (World* each : {&world, &again, &twice}) each->step();
      ASSERT_EQ(twice.state_hash(), again.state_hash()) << seed;
    }
    for (const BodyId id : world.body_ids()) {
      const BodyState& other = again.state(again.find_body(world.body(id).name));
      EXPECT_LT((world.state(id).position - other.position).norm(), 1e-6) << seed;
    }
  }
}

/// Returns which state an event begins or ends, and of which joint or bodies; none for impacts.
std::optional<std::pair<std::string, bool>> turn_of(const Event& event) {
  const std::string whose = event.joint ? "joint " + std::to_string(event.joint->value) +
                                              " coordinate " + std::to_string(event.coordinate)
                                        : "bodies " + std::to_string(event.body_a.value) + " and " +
                                              std::to_string(event.body_b.value);
  switch (event.kind) {
    case EventKind::kSaturated:
    case EventKind::kReleased:
      return std::pair("motor of " + whose, event.kind == EventKind::kSaturated);
    case EventKind::kSlips:
    case EventKind::kSticks:
      return std::pair("slip of " + whose, event.kind == EventKind::kSlips);
    case EventKind::kContactBegan:
    case EventKind::kContactEnded:
      return std::pair("contact of " + whose, event.kind == EventKind::kContactBegan);
    case EventKind::kRopeTaut:
    case EventKind::kRopeSlack:
      return std::pair("rope of " + whose, event.kind == EventKind::kRopeTaut);
    default:
      return std::nullopt;
  }
}

// States begin and end alternately, across ticks and from any start of a tick.
TEST(RandomEvents, BeginAndEndInTurn) {
  unsigned turns = 0;
  for (const Kind kind : {Kind::kMechanismWithMotors, Kind::kTouching, Kind::kTouchingWithMotors,
                          Kind::kMechanismWithServos, Kind::kTouchingWithServos, Kind::kAligned,
                          Kind::kTouchingWithPoses, Kind::kTouchingWithParts,
                          Kind::kTouchingCoupled, Kind::kTouchingOpen}) {
    for (unsigned seed = 0; seed < kScenes / 8; ++seed) {
      World world = world_of(scene_of(kind, seed));
      std::map<std::string, bool> has_begun;
      while (world.time() < 2.0 && !world.step().outcome.failed && !is_with_impulses(world)) {
        for (const Event& event : world.events()) {
          if (!event.joint &&
              event.kind == EventKind::kContactBegan)  // slipping or sticking starts anew
            has_begun.erase("slip of bodies " + std::to_string(event.body_a.value) + " and " +
                            std::to_string(event.body_b.value));
          const auto turn = turn_of(event);
          if (!turn) continue;
          const auto [known, is_new] = has_begun.insert(*turn);
          turns += !is_new;
          const bool is_again = !is_new && known->second == turn->second;
          EXPECT_FALSE(is_again) << "--kind " << static_cast<int>(kind) << " --seed " << seed
                                 << ": " << name(event.kind) << " again, " << turn->first << " at "
                                 << event.time << " s";
          known->second = turn->second;
        }
      }
    }
  }
  EXPECT_GT(turns, 10 * kScenes);
}

// The cost is one to three substeps (constraint_sim_event_costs); a count, the same on every
// machine.
TEST(EventCosts, OfShippedScenesAreAtMostFiveSubsteps) {
  for (const char* name : event_costs::kScenes) {
    World world = shipped(name);
    const event_costs::Costs costs = event_costs::follow(world, event_costs::kDuration);
    EXPECT_GT(costs.events, 0u) << name;
    EXPECT_LE(costs.of_an_event(), 5.0 * costs.ordinary()) << name;
  }
}

// The judge finds errors: with the work of motors neglected, scenes in which motors lift gain
// energy.
TEST(JudgeOfEvents, FindsEnergyThatHasNoCause) {
  unsigned found = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    Scene scene = scene_of(Kind::kMechanismWithMotors, seed);
    bool any = false;
    for (Joint& joint : scene.parts.joints)
      for (CoordinateLaw& law : joint.coordinates)
        if (law.motor) {
          any = true;
          law.motor->force = 4.0;  // pushes permanently, at no rate
          law.motor->bias = law.motor->amplitude = law.motor->max_force = 0.0;
          law.friction = 0.0;
        }
    if (!any) continue;
    Verdict verdict;
    follow(scene, &verdict);
    found += !verdict.findings.empty();
  }
  EXPECT_GT(found, 3u);
}

}  // namespace
}  // namespace constraint_sim::engine::random_events
