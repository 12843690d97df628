// Elements of URDFs, one at a time, and their errors.

#include <array>
#include <cstdio>

#include "constraint_sim/engine/scene.h"
#include "draw.h"
#include "engine/math/elementary.h"
#include "memory_peak.h"
#include "robots.h"
#include "urdf/contact_exceptions.h"
#include "urdf/meshes.h"
#include "urdf/parse.h"
#include "urdf/prefixed.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using engine::JointKind;
using engine::MemoryPeak;
using engine::refusal;
using engine::World;

const char* const kInertial =
    "<inertial><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' iyy='0.1' iyz='0' izz='0.1'/>"
    "</inertial>";

std::string link(const std::string& name, const std::string& inside = kInertial) {
  return "<link name='" + name + "'>" + inside + "</link>";
}

std::string joint(const std::string& name, const std::string& type, const std::string& parent,
                  const std::string& child, const std::string& inside = "") {
  return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent +
         "'/><child link='" + child + "'/>" + inside + "</joint>";
}

std::string robot(const std::string& inside) { return "<robot name='r'>" + inside + "</robot>"; }

const char* const kLimit =
    "<axis xyz='0 1 0'/><limit lower='-1' upper='2' effort='7' velocity='3'/>";

Robot add(const std::string& inside, World* world, const RobotOptions& options = {}) {
  return add_robot(robot(inside), options, world);
}

TEST(Urdf, JointsBecomeThoseOfTheEngine) {
  World world;
  RobotOptions options;
  options.extra = "motors: {b: {bias: 0.5}}";
  const Robot r =
      add(link("base") + link("1") + link("2") + link("3") + link("4") + link("5") +
              joint("a", "continuous", "base", "1", "<axis xyz='0 0 2'/>") +
              joint("b", "revolute", "1", "2",
                    std::string(kLimit) + "<dynamics damping='0.2' friction='0.3'/>") +
              joint("c", "prismatic", "2", "3", kLimit) + joint("d", "floating", "3", "4") +
              joint("e", "planar", "4", "5", "<axis xyz='0 0 1'/>"),
          &world, options);
  EXPECT_EQ(r.constraints, (std::vector<std::string>{"a", "b", "c", "e"}));
  EXPECT_EQ(r.bodies.size(), 6u);
  const auto at = [&](const char* name) { return world.joint(world.find_joint(name)); };
  EXPECT_EQ(at("a").kind, JointKind::kHinge);
  EXPECT_FALSE(at("a").coordinates[0].is_limited());
  EXPECT_EQ(at("b").kind, JointKind::kHinge);
  EXPECT_EQ(at("b").coordinates[0].lower, -1.0);
  EXPECT_EQ(at("b").coordinates[0].upper, 2.0);
  EXPECT_EQ(at("b").coordinates[0].damping, 0.2);
  EXPECT_EQ(at("b").coordinates[0].friction, 0.3);
  ASSERT_TRUE(at("b").coordinates[0].motor);
  EXPECT_EQ(at("b").coordinates[0].motor->bias, 0.5);
  EXPECT_EQ(at("b").coordinates[0].motor->max_force, 7.0);
  EXPECT_EQ(r.bounds.at("b").effort, 7.0);
  EXPECT_EQ(r.bounds.at("b").velocity, 3.0);
  EXPECT_EQ(at("c").kind, JointKind::kSlider);
  EXPECT_EQ(at("e").kind, JointKind::kPlanar);
  // z of the frame is the axis
  EXPECT_NEAR((at("b").frame_a * Vector3d::UnitZ() - Vector3d::UnitY()).norm(), 0.0, 1e-15);
}

// Rotations come from the engine's own sine, not from that of the C library, which urdfdom uses.
TEST(Urdf, RotationsAreTheSameBitsOnEveryMachine) {
  engine::Draw draw(1);
  std::string inside = link("base");
  std::vector<Vector3d> angles;
  for (int i = 0; i < 200; ++i) {
    angles.push_back(i == 0 ? Vector3d(0.0, 0.0, 0.0) : Vector3d(3.0 * draw.vector()));
    const std::string name = std::to_string(i);
    char rpy[100];
    std::snprintf(rpy, sizeof rpy, "%.17g %.17g %.17g", angles.back().x(), angles.back().y(),
                  angles.back().z());
    inside += link(name) + joint("j" + name, "floating", "base", name,
                                 std::string("<origin rpy = '") + rpy + "'/>");
  }
  const auto model = parse_urdf(robot("<!-- rpy= rpy='x' -->" + inside));
  for (std::size_t i = 0; i < angles.size(); ++i) {
    const Vector3d half = 0.5 * angles[i];
    const auto [s_x, c_x] = engine::math::sin_cos(half.x());
    const auto [s_y, c_y] = engine::math::sin_cos(half.y());
    const auto [s_z, c_z] = engine::math::sin_cos(half.z());
    urdf::Rotation expected;
    expected.x = s_x * c_y * c_z - c_x * s_y * s_z;
    expected.y = c_x * s_y * c_z + s_x * c_y * s_z;
    expected.z = c_x * c_y * s_z - s_x * s_y * c_z;
    expected.w = c_x * c_y * c_z + s_x * s_y * s_z;
    expected.normalize();
    const urdf::Rotation& found =
        model->getJoint("j" + std::to_string(i))->parent_to_joint_origin_transform.rotation;
    EXPECT_EQ(found.x, expected.x) << i;
    EXPECT_EQ(found.y, expected.y) << i;
    EXPECT_EQ(found.z, expected.z) << i;
    EXPECT_EQ(found.w, expected.w) << i;
  }
}

// A rotated load is fixed to an arm: the body has the mass and inertia of both.
TEST(Urdf, FixedLinksAreLumped) {
  World world;
  const Robot r =
      add(link("base") +
              link("load",
                   "<inertial><origin xyz='0 0 1' rpy='0 0 1.5707963267948966'/><mass value='3'/>"
                   "<inertia ixx='0.4' ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.3'/></inertial>") +
              link("tip", "") + joint("f", "fixed", "base", "load") +
              joint("g", "fixed", "load", "tip", "<origin xyz='1 0 0'/>"),
          &world);
  ASSERT_EQ(world.body_ids().size(), 1u);
  const engine::Body& body = world.body(world.find_body("base/com"));
  EXPECT_EQ(body.mass, 4.0);
  EXPECT_NEAR((body.state.position - Vector3d(0.0, 0.0, 0.75)).norm(), 0.0, 1e-15);
  // reduced mass 0.75 kg at 1 m, and x and y of the load are exchanged
  EXPECT_NEAR((body.inertia - Vector3d(0.1 + 0.2 + 0.75, 0.1 + 0.4 + 0.75, 0.4)).norm(), 0.0,
              1e-14);
  EXPECT_EQ(r.links.size(), 3u);
  EXPECT_NEAR(distance(frame_of(world, r.links.back()), Isometry3d(Eigen::Translation3d(1, 0, 0))),
              0.0, 1e-15);
}

TEST(Urdf, ProductsOfInertiaTurnTheBody) {
  World world;
  const Robot r =
      add(link("base",
               "<inertial><mass value='1'/><inertia ixx='0.3' ixy='0.1' ixz='0' iyy='0.3' iyz='0' "
               "izz='0.35'/></inertial>"),
          &world);
  const engine::Body& body = world.body(world.find_body("base/com"));
  Vector3d moments = body.inertia;
  std::sort(moments.data(), moments.data() + 3);
  EXPECT_NEAR((moments - Vector3d(0.2, 0.35, 0.4)).norm(), 0.0, 1e-15);
  const Eigen::Matrix3d R = body.state.orientation.toRotationMatrix();
  Eigen::Matrix3d inertia;
  inertia << 0.3, 0.1, 0.0, 0.1, 0.3, 0.0, 0.0, 0.0, 0.35;
  EXPECT_NEAR((R * body.inertia.asDiagonal() * R.transpose() - inertia).norm(), 0.0, 1e-15);
  EXPECT_NEAR(distance(frame_of(world, r.links[0]), Isometry3d::Identity()), 0.0, 1e-15);
}

TEST(Urdf, ShapesLieWhereTheUrdfHasThem) {
  const auto with = [](const std::string& geometry, const std::string& origin) {
    return std::string(kInertial) + "<collision>" + origin + "<geometry>" + geometry +
           "</geometry></collision>";
  };
  World world;
  const Robot r = add(link("base", with("<box size='1 2 3'/>", "")) +
                          link("a", with("<sphere radius='0.2'/>", "<origin xyz='0 0 -0.4'/>")) +
                          link("b", with("<cylinder radius='0.1' length='0.5'/>", "")) +
                          link("c", with("<mesh filename='package://x/y.stl'/>", "")) +
                          joint("1", "floating", "base", "a", "<origin xyz='9 0 0'/>") +
                          joint("2", "floating", "base", "b", "<origin xyz='-9 0 0'/>") +
                          joint("3", "floating", "base", "c"),
                      &world);
  EXPECT_FALSE(world.body(world.find_body("base/com")).shape_pose);
  const engine::Body& a = world.body(world.find_body("a/com"));
  ASSERT_TRUE(a.shape_pose);
  EXPECT_EQ(a.shape_pose->position, Vector3d(0.0, 0.0, -0.4));
  const auto& cylinder = std::get<engine::Cylinder>(world.body(world.find_body("b/com")).shape);
  EXPECT_EQ(cylinder.radius, 0.1);
  EXPECT_EQ(cylinder.length, 0.5);
  EXPECT_TRUE(std::holds_alternative<engine::Point>(world.body(world.find_body("c/com")).shape));
  ASSERT_EQ(r.warnings.size(), 1u);
  EXPECT_EQ(r.warnings[0],
            "link 'c': the mesh 'package://x/y.stl' does not collide: its file is not known");
}

// All shapes of links on fixed joints are parts of one body, whose mass, centre of mass and inertia
// are those of all links; each part has the friction of its link.
TEST(Urdf, LinksOnFixedJointsAreOneBodyWithAllShapes) {
  const auto ball = [](const char* origin) {
    return std::string("<collision><origin xyz='") + origin +
           "'/><geometry><sphere radius='0.1'/></geometry></collision>";
  };
  const std::string heavy =
      "<inertial><origin xyz='0.1 0.2 0.3' rpy='0.3 -0.2 0.5'/><mass value='6'/>"
      "<inertia ixx='0.3' ixy='0.02' ixz='0' iyy='0.2' iyz='0.01' izz='0.25'/></inertial>";
  World world, whole;
  RobotOptions options;
  options.extra =
      "links: {pad: {friction: 0.9}, hand: {restitution: 0.5}, ghost: {no_collision: true}}";
  const std::string glue = joint("wrist", "fixed", "base", "hand", "<origin xyz='5 0 0'/>") +
                           joint("glue", "fixed", "base", "pad", "<origin xyz='0 0 1'/>") +
                           joint("veil", "fixed", "base", "ghost", "<origin xyz='0 0 2'/>");
  const Robot r = add(link("base", heavy + ball("1 0 0") + ball("0 1 0")) +
                          link("hand", kInertial + ball("0 0 0")) + link("pad", ball("0 0 1")) +
                          link("ghost", ball("0 0 0")) + glue,
                      &world, options);
  EXPECT_EQ(r.bodies, std::vector<std::string>{"base/com"});
  EXPECT_EQ(r.constraints, std::vector<std::string>{});
  EXPECT_EQ(r.warnings, std::vector<std::string>{});
  EXPECT_EQ(r.links.size(), 4u);
  add(link("base", heavy) + link("hand", kInertial) + link("pad", "") + link("ghost", "") + glue,
      &whole);
  const engine::Body body = world.body(world.find_body("base/com"));
  const engine::Body bare = whole.body(whole.find_body("base/com"));
  EXPECT_EQ(body.mass, bare.mass);
  EXPECT_EQ(body.inertia, bare.inertia);
  EXPECT_EQ(body.state.position, bare.state.position);
  const auto& parts = *std::get<engine::Compound>(body.shape).parts;
  const Vector3d centres[] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 2.0}, {5.0, 0.0, 0.0}};
  ASSERT_EQ(parts.size(), 4u);  // the ghost does not collide
  for (std::size_t i = 0; i < 4; ++i) {
    const Vector3d centre = body.state.position + body.state.orientation * parts[i].pose.position;
    EXPECT_LT((centre - centres[i]).norm(), 1e-14) << i;
    EXPECT_EQ(parts[i].friction.value_or(body.friction), i == 2 ? 0.9 : 0.0) << i;
    EXPECT_EQ(parts[i].restitution.value_or(body.restitution), i == 3 ? 0.5 : 0.0) << i;
  }
}

// Masses without inertias: by the shape, rotated and beside the centre of mass; by a sphere of
// water; and of a thin rod. A mass on a fixed joint has its parent's inertia.
TEST(Urdf, InertiasOfZeroAreFilledInAndNamed) {
  const auto mass = [](const std::string& value, const std::string& more) {
    return "<inertial><origin xyz='0.1 0 0'/><mass value='" + value + "'/><inertia " + more +
           "/></inertial>";
  };
  const std::string zero = "ixx='0' ixy='0' ixz='0' iyy='0' iyz='0' izz='0'";
  const std::string box =
      "<collision><origin rpy='0 0 1.5707963267948966' xyz='1 0 0'/><geometry>"
      "<box size='1 2 3'/></geometry></collision>";
  World world;
  const Robot r =
      add(link("base") + link("camera", mass("0.2", zero)) + link("arm", mass("12", zero) + box) +
              link("load", mass("3", zero)) +
              link("rod", mass("1", "ixx='0' ixy='0' ixz='0' iyy='0.5' iyz='0' izz='0.5'")) +
              joint("f", "fixed", "base", "camera") + joint("a", "continuous", "base", "arm") +
              joint("b", "continuous", "arm", "load") + joint("c", "continuous", "load", "rod"),
          &world);
  const auto moments = [&](const char* body) { return world.body(world.find_body(body)).inertia; };
  // 12 kg (1 + 9, 4 + 9, 1 + 4) / 12, with x and y exchanged
  EXPECT_LT((moments("arm/com") - Vector3d(10.0, 13.0, 5.0)).cwiseAbs().minCoeff(), 1e-12);
  EXPECT_NEAR(moments("arm/com").sum(), 28.0, 1e-12);
  const engine::Body arm = world.body(world.find_body("arm/com"));
  const Vector3d along_box_x =
      arm.state.orientation.conjugate() * Vector3d::UnitY();  // x of the box, in the body
  EXPECT_NEAR(along_box_x.cwiseAbs2().dot(arm.inertia), 13.0, 1e-12);
  EXPECT_NEAR(arm.state.position.x(), 0.1, 1e-15);
  // 0.4 m r², where 4/3 pi r³ 1000 kg/m³ = 3 kg: r = 0.0894700 m
  EXPECT_LT((moments("load/com") - Vector3d::Constant(0.4 * 3.0 * 0.08947 * 0.08947)).norm(), 1e-6);
  EXPECT_LT((moments("rod/com") - Vector3d(5e-5, 0.5, 0.5)).norm(), 1e-15);
  EXPECT_EQ(
      r.warnings,
      (std::vector<std::string>{
          "link 'rod' has a principal moment of inertia of 0, as a thin rod: it gets 5e-05 kg "
          "m^2",
          "link 'arm' has a mass and an inertia of 0: it gets that of its shape",
          "link 'load' has a mass and an inertia of 0: it gets that of a sphere with the "
          "density of water, whose radius is 0.089470 m"}));
}

// A table of a top and four legs, in one link, stands on its legs: at rest, the floor carries
// m g, and nothing sinks beyond the tolerance of contacts.
TEST(Urdf, ATableStandsOnItsLegs) {
  std::string table =
      "<inertial><origin xyz='0.1 0 0.6'/><mass value='10'/>"
      "<inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1.5'/></inertial>"
      "<collision><origin xyz='0 0 0.7'/><geometry><box size='1 1 0.1'/></geometry></collision>";
  for (const char* at : {"0.4 0.4", "-0.4 0.4", "0.4 -0.4", "-0.4 -0.4"})
    table += std::string("<collision><origin xyz='") + at +
             " 0.05'/><geometry><sphere radius='0.05'/></geometry></collision>";
  engine::WorldOptions world_options;
  world_options.time_step = 0.01;
  World world(world_options);
  engine::Body floor;
  floor.name = "floor";
  floor.type = engine::BodyType::kStatic;
  floor.shape = engine::Plane{};
  floor.friction = 0.5;
  world.add_body(floor);
  RobotOptions options;
  options.extra = "links: {table: {friction: 0.5}}";
  add(link("table", table), &world, options);
  const engine::BodyState before = world.state(world.find_body("table/com"));
  double force = 0.0;
  for (int i = 0; i < 200; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    force = 0.0;
    for (const engine::Contact& contact : world.contacts()) force += contact.normal_force;
  }
  EXPECT_NEAR(force, 10.0 * 9.81, 1e-3 * 98.1);
  const engine::BodyState after = world.state(world.find_body("table/com"));
  EXPECT_LT((after.position - before.position).norm(), 1e-4);
  EXPECT_LT(after.orientation.angularDistance(before.orientation), 1e-4);
}

TEST(Urdf, MoreShapesThanABodyHasAreRefused) {
  std::string balls = kInertial;
  for (int i = 0; i < 4097; ++i)
    balls += "<collision><origin xyz='" + std::to_string(i) +
             " 0 0'/><geometry><sphere radius='0.1'/></geometry></collision>";
  World world;
  EXPECT_NE(refusal([&] {
              add(link("base", balls), &world);
            }).find("link 'base' has a body with more than 4096 collision shapes"),
            std::string::npos);
}

// ---- meshes

TEST(Meshes, PathsBecomeUris) {
  for (const auto& [name, uri] :
       {std::pair<const char*, const char*>{"a.stl", "file:///r/my%20robot/a.stl"},
        {"./meshes/a b.stl", "file:///r/my%20robot/meshes/a%20b.stl"},
        {"../a.stl", "file:///r/my%20robot/../a.stl"},
        {"file://a.stl", "file:///r/my%20robot/a.stl"},
        {"file:///x/a.stl", "file:///x/a.stl"},
        {"file://localhost/x/a.stl", "file:///x/a.stl"},
        {"file:///x/a%20b c.stl", "file:///x/a%20b%20c.stl"},
        {"/x/100%.stl", "file:///x/100%25.stl"},
        {"package://p/a.stl", "package://p/a.stl"}})
    EXPECT_EQ(mesh_uri(name, "/r/my robot"), uri) << name;
  EXPECT_EQ(mesh_uri("a.stl", ""), "");
  EXPECT_EQ(mesh_uri("/a.stl", ""), "file:///a.stl");
  EXPECT_EQ(path_of_file_uri("file:///r/my%20robot/100%25.stl"), "/r/my robot/100%.stl");
}

TEST(Meshes, AreFoundBesideTheUrdfOrNamed) {
  const std::string mesh = "<geometry><mesh filename='m/a.stl'/></geometry>";
  const std::string inside = link("base", std::string(kInertial) + "<visual>" + mesh +
                                              "</visual><collision>" + mesh + "</collision>");
  RobotOptions options;
  std::vector<std::string> asked;
  options.mesh_exists = [&](const std::string& uri) {
    asked.push_back(uri);
    return uri == "file:///there/m/a.stl";
  };
  options.folder = "/there";
  World world;
  const Robot found = add(inside, &world, options);
  ASSERT_EQ(found.visuals.size(), 1u);
  EXPECT_EQ(static_cast<const urdf::Mesh&>(*found.visuals[0].geometry).filename,
            "file:///there/m/a.stl");
  EXPECT_EQ(
      found.warnings,
      std::vector<std::string>{
          "link 'base': the mesh 'file:///there/m/a.stl' does not collide: it cannot be read"});
  options.folder = "/elsewhere";
  EXPECT_NE(refusal([&] {
              add(inside, &world, options);
            }).find("link 'base': there is no mesh 'file:///elsewhere/m/a.stl'"),
            std::string::npos);
  // a text has no folder: the robot is there without a picture
  options.folder = "";
  asked.clear();
  World other;
  const Robot text = add(inside, &other, options);
  EXPECT_TRUE(asked.empty());
  EXPECT_TRUE(text.visuals.empty());
  ASSERT_EQ(text.warnings.size(), 2u);
  EXPECT_EQ(text.warnings[0],
            "link 'base': the mesh 'm/a.stl' does not collide: its file is not known");
  EXPECT_NE(text.warnings[1].find("the mesh 'm/a.stl' is not shown: its name is relative"),
            std::string::npos);
}

// ---- pairs that do not collide

/// Three balls on a base that is far away, each on a hinge at its centre.
std::string three_balls(double x_1, double x_2, double x_3) {
  const std::string ball =
      std::string(kInertial) + "<collision><geometry><sphere radius='0.1'/></geometry></collision>";
  std::string text = link("base");
  int i = 0;
  for (const double x : {x_1, x_2, x_3}) {
    const std::string name = std::to_string(++i);
    text += link(name, ball) + joint("j" + name, "continuous", "base", name,
                                     "<origin xyz='" + std::to_string(x) + " 0 0'/>");
  }
  return text;
}

std::vector<std::string> exceptions_of(const World& world) {
  std::vector<std::string> names;
  for (const engine::JointId id : world.joint_ids())
    if (is_contact_exception(world.joint(id))) names.push_back(world.joint(id).name);
  return names;
}

// Links that overlap where they are loaded do not collide.
TEST(ContactExceptions, OverlappingLinksAreNamedAndDoNotCollide) {
  World world;
  RobotOptions options;
  options.prefix = "p_";
  options.fixed = true;
  const Robot r = add(three_balls(1.0, 1.15, 1.36), &world, options);
  EXPECT_EQ(r.warnings, std::vector<std::string>{
                            "links '1' and '2' overlap, and do not collide with each other"});
  EXPECT_EQ(exceptions_of(world), std::vector<std::string>{"p_no_contact/1/2"});
  for (int i = 0; i < 10; ++i) {
    world.step();
    EXPECT_TRUE(world.contacts().empty());
  }
  // without the exception the balls collide
  world.remove_joint(world.find_joint("p_no_contact/1/2"));
  world.step();
  EXPECT_FALSE(world.contacts().empty());
}

TEST(ContactExceptions, AreListedInTheYamlAndTheSrdf) {
  World world;
  RobotOptions options;
  options.extra = "no_contact: [['1', '2'], ['1', base]]";
  options.srdf =
      "<?xml version='1.0'?><robot name='r'><!-- <disable_collisions link1='2' link2='3'/> -->"
      "<disable_collisions link1='3' link2='1' reason='Never'/>"
      "<disable_collisions link1='3' link2='camera' reason='Never'/></robot>";
  const Robot r = add(three_balls(1.0, 2.0, 3.0), &world, options);
  EXPECT_EQ(exceptions_of(world), (std::vector<std::string>{"no_contact/1/2", "no_contact/1/3"}));
  EXPECT_EQ(r.warnings,
            std::vector<std::string>{"the SRDF has links that the URDF does not have: 'camera'"});
  const auto fault = [&](const std::string& extra, const std::string& srdf) {
    RobotOptions wrong;
    wrong.extra = extra;
    wrong.srdf = srdf;
    World other;
    return refusal([&] { add(three_balls(1.0, 2.0, 3.0), &other, wrong); });
  };
  EXPECT_NE(fault("no_contact: [['1', '4']]", "").find("no_contact: the URDF has no link '4'"),
            std::string::npos);
  EXPECT_NE(fault("no_contact: [['1']]", "").find("must be the names of two links"),
            std::string::npos);
  EXPECT_NE(fault("", "<robot><disable_collisions link1='1'/></robot>").find("link1 and link2"),
            std::string::npos);
}

// A listed pair of links that are parts of bodies counts where all pairs of links of these bodies
// are listed; else the bodies collide, and the pair is named.
TEST(ContactExceptions, OfPartsAreThoseOfTheirBodies) {
  const std::string ball =
      std::string(kInertial) + "<collision><geometry><sphere radius='0.1'/></geometry></collision>";
  const std::string text = link("base") + link("a", ball) + link("a_tip", ball) + link("b", ball) +
                           joint("j", "continuous", "base", "a", "<origin xyz='1 0 0'/>") +
                           joint("f", "fixed", "a", "a_tip", "<origin xyz='1 0 0'/>") +
                           joint("k", "continuous", "base", "b", "<origin xyz='X 0 0'/>");
  const auto at = [&](const char* x) {
    std::string placed = text;
    return placed.replace(placed.find('X'), 1, x);
  };
  World world;
  RobotOptions options;
  options.extra = "no_contact: [[a_tip, b]]";
  const Robot some = add(at("4"), &world, options);
  EXPECT_EQ(exceptions_of(world), std::vector<std::string>{});
  EXPECT_EQ(some.warnings,
            std::vector<std::string>{
                "pairs of links that are listed and collide nevertheless, since other links on the "
                "same bodies are not listed: 'a_tip' and 'b'"});
  World listed;
  options.extra = "no_contact: [[a_tip, b], [b, a]]";
  EXPECT_EQ(add(at("4"), &listed, options).warnings, std::vector<std::string>{});
  EXPECT_EQ(exceptions_of(listed), std::vector<std::string>{"no_contact/a/b"});
  World overlapping;
  options.extra = "";
  EXPECT_EQ(add(at("2.15"), &overlapping, options).warnings,
            std::vector<std::string>{
                "links 'a_tip' and 'b' overlap, and do not collide with each other; these are all "
                "links of two bodies, a, a_tip and b"});
}

// Exceptions hold nothing: a robot moves with them as without.
TEST(ContactExceptions, HoldNothing) {
  World with, without;
  RobotOptions options;
  add(three_balls(1.0, 2.0, 3.0), &without, options);
  options.extra = "no_contact: [['1', '2'], ['2', '3'], ['1', '3']]";
  add(three_balls(1.0, 2.0, 3.0), &with, options);
  for (World* world : {&with, &without}) {
    engine::BodyState state = world->state(world->find_body("1/com"));
    state.angular_velocity.x() = 3.0;
    world->set_state(world->find_body("1/com"), state);
    for (int i = 0; i < 100; ++i) world->step();
  }
  for (const char* name : {"base/com", "1/com", "2/com", "3/com"})
    // methods group rows in other orders: rounding
    EXPECT_LT((with.state(with.find_body(name)).position -
               without.state(without.find_body(name)).position)
                  .norm(),
              1e-12)
        << name;
}

TEST(Urdf, MimicsAreGears) {
  World world;
  RobotOptions options;
  options.extra = "positions: {a: 0.2}";
  add(link("base") + link("1") + link("2") + joint("a", "continuous", "base", "1") +
          joint("b", "continuous", "base", "2", "<mimic joint='a' multiplier='-2' offset='0.1'/>"),
      &world, options);
  EXPECT_NEAR(position_of(world, "b"), -0.3, 1e-15);
  const engine::BodyId body = world.find_body("1/com");
  engine::BodyState state = world.state(body);
  state.angular_velocity.x() = 1.0;
  world.set_state(body, state);
  for (int i = 0; i < 100; ++i) world.step();
  // a gear holds to rounding
  EXPECT_NEAR(position_of(world, "b"), 0.1 - 2.0 * position_of(world, "a"), 1e-12);
}

TEST(Urdf, RobotsOfOneDescriptionHavePrefixes) {
  World world;
  RobotOptions options;
  const std::string text = link("base") + link("1") + joint("a", "continuous", "base", "1");
  for (const char* prefix : {"left/", "right/"}) {
    options.prefix = prefix;
    options.pose.position.x() += 1.0;
    const Robot r = add(text, &world, options);
    EXPECT_EQ(r.bodies[1], std::string(prefix) + "1/com");
    EXPECT_EQ(r.links[1].name, std::string(prefix) + "1");
    EXPECT_EQ(r.constraints[0], std::string(prefix) + "a");
  }
  EXPECT_EQ(world.state(world.find_body("right/base/com")).position.x(), 2.0);
  EXPECT_NE(refusal([&] { add(text, &world, options); }).find("right/base/com"), std::string::npos);
}

TEST(Urdf, ARootNamedWorldStands) {
  World world;
  add("<link name='world'/>" + link("1") + joint("a", "continuous", "world", "1"), &world);
  EXPECT_EQ(world.body(world.find_body("world/com")).type, engine::BodyType::kStatic);
}

// ---- faults

struct Fault {
  const char* name;
  std::string urdf;
  std::string extra;
  const char* part;  // part of the message
};

TEST(Urdf, FaultsAreNamedAndNothingIsAdded) {
  const std::string two = link("base") + link("1");
  const std::string tree = two + joint("a", "continuous", "base", "1");
  const std::string ball = "<collision><geometry><sphere radius='-1'/></geometry></collision>";
  const Fault faults[] = {
      {"empty", "", "", "the text is empty"},
      {"no XML", "base: 1", "", "urdf: "},
      {"no robot", "<link name='a'/>", "", "urdf: "},
      {"no link", robot(""), "", "urdf: "},
      {"two roots", robot(two), "", "Two root links found"},
      {"link twice", robot(link("base") + link("base")), "", "'base' is not unique"},
      {"unknown link", robot(link("base") + joint("a", "continuous", "base", "1")), "",
       "child link [1] of joint [a] not found"},
      {"two parents",
       robot(tree + link("2") + joint("b", "continuous", "base", "2") +
             joint("c", "continuous", "2", "1")),
       "", "link '1' is the child of two joints, 'a' and 'c'"},
      {"cycle",
       robot(tree + link("2") + link("3") + joint("b", "continuous", "2", "3") +
             joint("c", "continuous", "3", "2")),
       "", "is in a cycle of joints"},
      {"no limit", robot(two + joint("a", "revolute", "base", "1")), "", "urdf: "},
      {"no type", robot(two + joint("a", "screw", "base", "1")), "", "urdf: "},
      {"limits swapped",
       robot(two + joint("a", "revolute", "base", "1",
                         "<limit lower='1' upper='0' effort='1' velocity='1'/>")),
       "", "joint 'a' has a lower limit above the upper one"},
      {"no inertial",
       robot(link("base", "") + link("1", "") + joint("a", "continuous", "base", "1")), "",
       "link 'base' moves and has no mass, and neither has any other link"},
      {"no mass",
       robot(link("base",
                  "<inertial><mass value='0'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' "
                  "iyz='0' izz='1'/></inertial>")),
       "", "link 'base' moves and has no mass"},
      {"negative mass",
       robot(link("base",
                  "<inertial><mass value='-1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' "
                  "iyz='0' izz='1'/></inertial>")),
       "", "link 'base' must have a mass >= 0"},
      {"negative moment",
       robot(link("base",
                  "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' "
                  "iyz='0' izz='-0.1'/></inertial>")),
       "", "link 'base' has no inertia, or one that is not positive definite"},
      {"inertia not definite",
       robot(link("base",
                  "<inertial><mass value='1'/><inertia ixx='1' ixy='2' ixz='0' iyy='1' "
                  "iyz='0' izz='1'/></inertial>")),
       "", "not positive definite"},
      {"negative radius", robot(link("base", kInertial + ball)), "", "radius"},
      {"no mesh",
       robot(link("base", std::string(kInertial) +
                              "<visual><geometry><mesh filename='package://nowhere/a.stl'/>"
                              "</geometry></visual>")),
       "", "link 'base': there is no mesh 'package://nowhere/a.stl'"},
      {"bad name", robot(link("a b")), "", "name"},
      {"mimics nothing", robot(two + joint("a", "continuous", "base", "1", "<mimic joint='b'/>")),
       "", "joint 'a' mimics 'b', which is no revolute"},
      {"mimics itself", robot(two + joint("a", "continuous", "base", "1", "<mimic joint='a'/>")),
       "", "mimics itself"},
      {"name taken", robot(link("taken")), "", "there is already a body named 'taken'"},
      {"extra is no YAML", robot(tree), "a: [", "extra"},
      {"extra key", robot(tree), "mass: 1", "mass"},
      {"extra joint", robot(tree), "positions: {b: 1}", "positions: the URDF has no joint 'b'"},
      {"extra link", robot(tree), "links: {b: {friction: 1}}", "links: the URDF has no link 'b'"},
      {"extra motor", robot(tree), "motors: {a: {speed: 1}}", "speed"},
      {"extra constraint", robot(tree), "constraints: [{name: c, type: ball, body_a: b}]",
       "there is no body 'b'"},
      {"extra constraint twice", robot(tree),
       "constraints: [{name: a, type: ball, body_a: base, body_b: '1'}]", "a"},
  };
  World world;
  world.add_body(engine::make_body("taken", engine::Sphere{1.0}, 1.0, Vector3d::Zero()));
  const std::uint64_t before = world.state_hash();
  RobotOptions options;
  options.mesh_exists = [](const std::string&) { return false; };
  for (const Fault& fault : faults) {
    options.extra = fault.extra;
    const std::string message = refusal([&] { add_robot(fault.urdf, options, &world); });
    EXPECT_NE(message.find(fault.part), std::string::npos) << fault.name << ": '" << message << "'";
    EXPECT_EQ(world.state_hash(), before) << fault.name;
    EXPECT_EQ(world.body_ids().size(), 1u) << fault.name;
  }
}

// Names and frames of links close a loop, wherever their centres of mass are.
TEST(Urdf, ConstraintsBesideItAreOfLinks) {
  const std::string heavy_below =
      "<inertial><origin xyz='0.1 0 -0.3' rpy='0.2 0 0'/><mass value='1'/><inertia ixx='0.1' "
      "ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.15'/></inertial>";
  World world;
  RobotOptions options;
  options.prefix = "p/";
  options.extra =
      "constraints:\n"
      "  - {name: loop, type: point_on_line, body_a: '1', anchor_a: [0, 0, 1], axis_a: [0, 1, 0],"
      " body_b: base, anchor_b: [0, 0, 1]}\n"
      "  - {name: anchor, type: ball, body_b: '1', anchor_a: [0, 0, 2], anchor_b: [0, 0, 2]}\n"
      "  - {name: train, type: gear, joints: [a, b], ratio: 2}\n";
  add(link("base", heavy_below) + link("1", heavy_below) + link("2", heavy_below) +
          joint("a", "continuous", "base", "1", "<axis xyz='0 1 0'/>") +
          joint("b", "continuous", "1", "2", "<axis xyz='0 1 0'/>"),
      &world, options);
  // rounding: all joints fit at the start
  for (const engine::JointId id : world.joint_ids())
    EXPECT_LT(world.joint_state(id).error, 1e-15) << world.joint(id).name;
  EXPECT_EQ(world.joint(world.find_joint("p/anchor")).body_a, engine::kWorldBody);
  EXPECT_EQ(world.joint(world.find_joint("p/train")).coupling.second, world.find_joint("p/b"));
}

// A constraint between links of one body is left out and named where it fits, and refused where it
// does not; so is a gear that needs it.
TEST(Urdf, ConstraintsWithinABodyAreLeftOutOrRefused) {
  const std::string text = link("base", kInertial) + link("hand", kInertial) +
                           joint("wrist", "fixed", "base", "hand", "<origin xyz='1 0 0'/>") +
                           link("arm", kInertial) + joint("a", "continuous", "base", "arm");
  const auto robot_with = [&](const std::string& constraints, World* world) {
    RobotOptions options;
    options.extra = "constraints:\n" + constraints;
    return add(text, world, options);
  };
  const std::string rod = "  - {name: rod, type: distance, body_a: base, body_b: hand, length: ";
  const std::string tip =
      "  - {name: tip, type: hinge, body_a: hand, body_b: base, anchor_b: [1, 0, 0]}\n";
  World world;
  const Robot robot = robot_with(rod + "1}\n" + tip, &world);
  EXPECT_EQ(robot.constraints, std::vector<std::string>{"a"});
  EXPECT_EQ(robot.warnings,
            (std::vector<std::string>{
                "constraint 'rod' is left out: links 'base' and 'hand' are one body",
                "constraint 'tip' is left out: links 'hand' and 'base' are one body"}));
  const std::pair<std::string, std::string> faults[] = {
      {rod + "1.5}\n",
       "links 'base' and 'hand' are one body, which the constraint does not fit by "
       "0.5"},
      {tip + "  - {name: g, type: gear, joints: [a, tip], ratio: 2}\n",
       "couples constraint 'tip', which is left out"}};
  for (const auto& [constraints, wanted] : faults) {
    World refused;
    try {
      robot_with(constraints, &refused);
      ADD_FAILURE() << wanted;
    } catch (const std::exception& error) {
      EXPECT_NE(std::string(error.what()).find(wanted), std::string::npos) << error.what();
    }
    EXPECT_TRUE(refused.body_ids().empty());
  }
}

// ---- malicious texts

std::string text_times(int count, const std::string& text) {
  std::string all;
  for (int i = 0; i < count; ++i) all += text;
  return all;
}

// ---- remains of xacro

TEST(Xacro, WhatWouldHaveBeenReplacedIsNamed) {
  const std::string base = link("base");
  const std::pair<std::string, const char*> texts[] = {
      {base + "\n<xacro:leg side='left'/>", "has <xacro:leg> (line 2)"},
      {"\n\n<xacro:include filename='a.xacro'/>" + base, "has <xacro:include> (line 3)"},
      {base + "<xacro:if value='1'>" + link("1") + "</xacro:if>", "has <xacro:if> (line 1)"},
      {link("${prefix}base"), "has ${prefix} (line 1)"},
      {link("base", std::string(kInertial) +
                        "<visual><geometry>\n<sphere radius='${2*r}'/></geometry>"
                        "</visual>"),
       "has ${2*r} (line 2)"},
      {link("base", std::string(kInertial) + "<visual><geometry><mesh filename='file://$(find "
                                             "r)/a.stl'/></geometry></visual>"),
       "has $(find r) (line 1)"},
      {"<xacro:a/><xacro:b/><xacro:c/><xacro:d/><xacro:e/><xacro:f/><xacro:g/>" + base,
       "<xacro:e> (line 1) and 2 more: run it"},
  };
  for (const auto& [inside, part] : texts) {
    World world;
    RobotOptions options;
    options.how_to_expand = "run it";
    const std::string message = refusal([&] { add_robot(robot(inside), options, &world); });
    EXPECT_NE(message.find("urdf: xacro has not been run"), std::string::npos) << message;
    EXPECT_NE(message.find(part), std::string::npos) << message;
    EXPECT_EQ(world.body_ids().size(), 0u);
  }
  // another prefix for xacro
  World world;
  const std::string other =
      "<?xml version='1.0'?><robot name='r' xmlns:x='http://www.ros.org/wiki/xacro'>" + base +
      "<x:leg/></robot>";
  EXPECT_NE(refusal([&] { add_robot(other, {}, &world); }).find("<x:leg>"), std::string::npos);
}

TEST(Xacro, DefinitionsAreNamedAndWhatIsNotReadIsNot) {
  World world;
  const Robot with =
      add("\n<xacro:property name='r' value='1'/><xacro:arg name='a' default='1'/>"
          "<xacro:macro name='leg'><link name='${side}'/><xacro:foot/></xacro:macro>" +
              link("base") + "<!-- <xacro:leg/> ${a} -->",
          &world);
  EXPECT_EQ(with.warnings, (std::vector<std::string>{
                               "definitions of xacro are left in the URDF and are not read: "
                               "<xacro:property> (line 2), <xacro:arg> (line 2), <xacro:macro> "
                               "(line 2)"}));
  World other;
  const Robot without =
      add("<gazebo><plugin name='${p}' file='$(find p)/p'/><xacro:p/></gazebo>"
          "<transmission name='${t}'/>" +
              link("base") + "<material name='cost_$5 $(x)'><color rgba='1 0 0 1'/></material>",
          &other);
  EXPECT_EQ(without.warnings,
            (std::vector<std::string>{
                "elements that are not read: <gazebo> (line 1), <transmission> (line 1)"}));
}

TEST(Elements, ThatAreNotReadAreCounted) {
  World world;
  const std::string inside =
      "\n<gazebo reference='base'><mu1>1</mu1><gazebo/></gazebo>\n<gazebo/>" +
      link("base",
           std::string(kInertial) +
               "<collision><geometry><sphere radius='1'/></geometry>\n<surface/></collision>"
               "<visual><geometry><sphere radius='1'/></geometry><material name='m'><color "
               "rgba='1 0 0 1'/></material></visual>") +
      link("tip") +
      "\n<joint name='j' type='continuous'><parent link='base'/><child link='tip'/>"
      "<axis xyz='0 0 1'/><safety_controller k_velocity='1'/></joint><!-- <sensor/> -->";
  const Robot robot = add(inside, &world);
  EXPECT_EQ(robot.warnings,
            (std::vector<std::string>{
                "elements that are not read: <gazebo> (2, first in line 2), <surface> in "
                "<collision> (line 4), <safety_controller> in <joint> (line 5)"}));
  std::string many = link("base");
  for (char c = 'a'; c < 'm'; ++c) many += std::string("<") + c + "/>";
  World other;
  const Robot of_many = add(many, &other);
  ASSERT_EQ(of_many.warnings.size(), 1u);
  EXPECT_NE(of_many.warnings[0].find("<j> (line 1) and 2 more"), std::string::npos)
      << of_many.warnings[0];
}

TEST(Elements, OtherFormatsAreRecognised) {
  const std::pair<const char*, const char*> texts[] = {
      {"<?xml version='1.0'?>\n<!-- <robot/> --><sdf version='1.7'><model name='m'/></sdf>",
       reads_sdf() ? "urdf: libsdformat rejects the SDF: A model must have at least one link"
                   : "built without libsdformat"},
      {"<model name='m'><link name='${a}'/></model>",
       "urdf: the text begins with <model>, which is SDF without its first element <sdf>; a URDF "
       "is "
       "XML and begins with <robot>, an SDF with <sdf>"},
      {"<mujoco model='m'><worldbody/></mujoco>", "<mujoco>, which is MJCF of MuJoCo"},
      {"<COLLADA/>", "urdf: "},
      {"bodies: [{name: a}]", "urdf: the text has no element of XML"},
      {"solid part\nfacet", "urdf: the text has no element of XML"},
      {"<!-- <robot/> -->", "urdf: the text has no element of XML"},
  };
  for (const auto& [text, part] : texts) {
    World world;
    const std::string message = refusal([&] { add_robot(text, {}, &world); });
    EXPECT_NE(message.find(part), std::string::npos) << message;
  }
}

// A parser that recurses from element to element would overflow the stack.
TEST(HostileUrdf, OfElementsTooDeepIsRejected) {
  World world;
  const auto answer_to = [&](const std::string& text) {
    return refusal([&] { add_robot(text, {}, &world); });
  };
  const std::string deep = "urdf: elements are nested more than 64 deep";
  for (const char* opening :
       {"<a>", "<robot>", "<a b='>'>", "<a b=\"</a>\">", "<a><!-- </a></a> -->",
        "<a><![CDATA[</a>]]>", "<a> /> ", "<a><b/>", "<a><b></b>", "<a><!x </a>"}) {
    for (const int count : {65, 40000}) {
      EXPECT_EQ(answer_to(text_times(count, opening)), deep) << opening;
      EXPECT_EQ(answer_to("<?xml version='1.0'?>\n<robot name='r'>" + text_times(count, opening) +
                          "</robot>"),
                deep)
          << opening;
    }
  }
  // a close tag hidden in a value of a declaration would hide its element
  EXPECT_EQ(answer_to(text_times(40000, "<a><?xml version=\"></a>\"?>")),
            "urdf: has a declaration `<?` within an element");
  EXPECT_EQ(world.body_ids().size(), 0u);
  // the deepest nesting that is parsed: unknown elements of a robot are skipped
  EXPECT_EQ(answer_to(robot(link("base") + text_times(60, "<a>") + text_times(60, "</a>"))), "");
}

// urdfdom frees links recursively from parent to child, however it ends.
TEST(HostileUrdf, OfTooManyLinksIsRejected) {
  std::string chain;
  for (int i = 0; i < 100000; ++i) {
    const std::string name = std::to_string(i);
    chain += "<link name='" + name + "'/>";
    if (i > 0) chain += joint("j" + name, "fixed", std::to_string(i - 1), name);
  }
  World world;
  EXPECT_EQ(refusal([&] { add_robot(robot(chain), {}, &world); }),
            "urdf: has more than 10000 links");
}

// Links in a cycle reference each other: urdfdom would never free them, whether it finds no root or
// another error. Memory must not grow after the first rejection; one such text took 4 MB.
TEST(HostileUrdf, OfLinksInACycleIsRejectedWithoutALeak) {
  std::string circle;
  for (int i = 0; i < 2000; ++i) {
    const std::string name = std::to_string(i);
    circle += link(name) + joint("j" + name, "fixed", name, std::to_string((i + 1) % 2000));
  }
  const std::string texts[] = {robot(circle), robot(link("root") + circle),
                               robot(link("a") + link("b") + circle),
                               robot(circle + joint("j", "fixed", "0", "none"))};
  World world;
  for (const std::string& text : texts) {
    const auto add = [&] {
      EXPECT_NE(refusal([&] { add_robot(text, {}, &world); }).find("in a cycle of joints"),
                std::string::npos);
    };
    add();
    const MemoryPeak memory;
    for (int i = 0; i < 10; ++i) add();
    EXPECT_LT(memory.grown_by(), 1e7);
  }
  EXPECT_NE(refusal([&] {
              add_robot(robot(link("a") + joint("j", "fixed", "a", "a")), {}, &world);
            }).find("in a cycle of joints"),
            std::string::npos);
}

// The description for programs that know no prefix is that of a robot with longer names.
TEST(Prefixed, LinksAndJointsHaveLongerNames) {
  const auto text = [](const std::string& p, const std::string& q) {
    return robot("<!-- <link name='x'/> -->" + link(p + "base") + link(p + "tip") +
                 link(p + "end") +
                 joint(q + "j", "revolute", p + "base", p + "tip",
                       std::string(kLimit) + "<origin xyz='1 0 0'/>") +
                 joint(q + "k", "continuous", p + "tip", p + "end",
                       "<mimic multiplier='2' joint='" + q + "j'/>") +
                 "<material name='m'/><gazebo reference='base'><link name='y'/></gazebo>");
  };
  const PrefixedUrdf prefixed = prefixed_urdf(text("", ""), "sim/left/", "left/");
  EXPECT_EQ(prefixed.text, text("sim/left/", "left/"));
  EXPECT_EQ(prefixed.joints, (std::vector<std::string>{"left/j", "left/k"}));
  EXPECT_EQ(prefixed_urdf(text("", ""), "", "").text, text("", ""));
  // names of meshes become those that other programs find
  const auto with_mesh = [](const std::string& file) {
    const std::string mesh =
        "<visual><geometry><mesh filename='" + file + "'></mesh></geometry></visual>";
    return robot(link("a", mesh) + link("b", mesh));
  };
  EXPECT_EQ(prefixed_urdf(with_mesh("m/a.stl"), "", "", "/r").text, with_mesh("file:///r/m/a.stl"));
  for (const char* name : {"package://p/a.stl", "m/a&amp;b.stl"})
    EXPECT_EQ(prefixed_urdf(with_mesh(name), "", "", "/r").text, with_mesh(name));
  EXPECT_EQ(prefixed_urdf(with_mesh("a.stl"), "", "").text, with_mesh("a.stl"));
}

}  // namespace
}  // namespace constraint_sim
