// Equations and responses of a group of touching bodies, without a world around them.

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_responses.h"

namespace constraint_sim::engine {
namespace {

/// Equations of a ball of 1 kg that touches the ground.
ContactEquations ball_on_ground() {
  ContactEquations equations;
  for (const int index : {0, 1}) equations.bodies().list().emplace_back().index = index;
  for (const std::size_t body : {0u, 1u}) equations.bodies().shapes().add(Body{}, body, 0);
  equations.bodies().list()[0].mass.inverse_mass = 1.0;
  equations.bodies().set_movable(1);
  ContactEquations::Contact& contact = equations.contacts().emplace_back();
  contact.a = 0;
  contact.b = 1;
  contact.shape_index_a = 0;
  contact.shape_index_b = 1;
  contact.acts = ContactEquations::Acts::kSticks;
  contact.feature.id = 1;
  List<BodyState> states(2);
  states[0].position.z() = 0.1;
  equations.bodies().gather(states, 0.0);
  equations.prepare_stages();
  return equations;
}

// A substep that is taken back has applied no impulse. So the feature of the last impulse, where a
// contact that opens again is reported, has to be the feature from before the substep.
TEST(ContactEquations, ASubstepThatIsTakenBackLeavesTheFeatureOfTheLastImpulse) {
  ContactEquations equations = ball_on_ground();
  ContactEquations::Contact& contact = equations.contacts()[0];
  equations.accept_without_motion(0.01);
  ASSERT_EQ(contact.touched.id, 1u);
  contact.feature.id = 2;
  equations.keep();
  equations.accept_without_motion(0.01);
  ASSERT_EQ(contact.touched.id, 2u);
  equations.restore();
  EXPECT_EQ(contact.touched.id, 1u);
}

// Where corners of two boxes meet, each box has a contact at the same place and along the same
// normal, of which the impulses of one are those of both.
TEST(ContactResponses, FindContactsAtTheSamePlace) {
  ContactEquations equations = ball_on_ground();
  equations.contacts().push_back(equations.contacts()[0]);
  const ContactMotion motion = equations.motion(equations.contacts()[0]);
  ContactResponses responses;
  responses.add(0, motion);
  ContactMotion other = motion;
  EXPECT_EQ(responses.find_twin(1, other, 1e-10, equations), 0);
  other.p.x() += 0.5e-10;
  EXPECT_EQ(responses.find_twin(1, other, 1e-10, equations), 0);
  other.p.x() += 1e-10;
  EXPECT_EQ(responses.find_twin(1, other, 1e-10, equations), -1) << "another place";
  other = motion;
  other.n = Eigen::AngleAxisd(1e-6, Eigen::Vector3d::UnitX()) * motion.n;
  EXPECT_EQ(responses.find_twin(1, other, 1e-10, equations), -1) << "another normal";
  equations.contacts()[1].shape_index_b = 0;
  EXPECT_EQ(responses.find_twin(1, motion, 1e-10, equations), -1) << "other shapes";
}

}  // namespace
}  // namespace constraint_sim::engine
