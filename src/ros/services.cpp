#include "ros/services.h"

#include <ros/console.h>

#include <exception>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "ros/conversions.h"
#include "ros/laws.h"
#include "ros/scenes.h"
#include "ros/time_conversions.h"
#include "sim/files.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

// Runs `work` and fills in what every answer has. Errors, bad input foremost, are answered and not
// thrown, so that roscpp passes the response on.
template <class Response, class Work>
bool answer(Response& response, Work work) {
  try {
    work();
    response.success = true;
  } catch (const std::exception& error) {
    response = Response{};
    response.status_message = error.what();
  }
  return true;
}

// The same of a service whose answer has no room for an error: its caller sees that it failed, and
// the log why.
template <class Work>
bool done(const char* service, Work work) {
  try {
    work();
    return true;
  } catch (const std::exception& error) {
    ROS_WARN("%s: %s", service, error.what());
    return false;
  }
}

template <class Response, class Change>
bool answer_edit(Stepper& stepper, Response& response, Change change) {
  return answer(response, [&] {
    const Boundary boundary = stepper.edit(change);
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
  });
}

// Bias, limit and timeout of a motor, of the first coordinate where there are several; amplitude,
// frequency and phase stay what they are. One that goes to a position, or with a force, no longer
// does.
void set_bias(World& world, const std::string& constraint, double bias, double max_force,
              double timeout) {
  const engine::JointId id = find_joint(world, "constraint", constraint);
  const engine::Joint& joint = world.joint(id);
  engine::Motor motor = joint.motor;
  if (joint.coordinates[0].motor) motor = *joint.coordinates[0].motor;
  motor.bias = bias;
  motor.max_force = max_force;
  motor.timeout = timeout;
  world.set_motor(id, motor);
}

}  // namespace

Services::Services(Stepper& stepper, const Publishers& publishers, const Parameters& parameters,
                   ServiceHandles handles)
    : stepper_(stepper), publishers_(publishers), parameters_(parameters) {
  const auto advertise_on = [&](ros::NodeHandle& handle, const char* name, auto handler) {
    servers_.push_back(handle.advertiseService(name, handler, this));
  };
  const auto advertise = [&](const char* name, auto handler) {
    advertise_on(handles.edits, name, handler);
  };
  advertise("add_body", &Services::add_body);
  advertise("remove_body", &Services::remove_body);
  advertise("add_distance_constraint", &Services::add_distance_constraint);
  advertise("add_constraint", &Services::add_constraint);
  advertise("remove_constraint", &Services::remove_constraint);
  advertise("set_motor_bias", &Services::set_motor_bias);
  advertise("set_constraint_properties", &Services::set_constraint_properties);
  advertise("apply_body_wrench", &Services::apply_body_wrench);
  advertise("clear_body_wrenches", &Services::clear_body_wrenches);
  advertise_on(handles.queries, "get_body_state", &Services::get_body_state);
  advertise("set_body_state", &Services::set_body_state);
  advertise("load_scene", &Services::load_scene);
  advertise("save_scene", &Services::save_scene);
  advertise_on(handles.pauses, "pause_physics", &Services::pause_physics);
  advertise_on(handles.pauses, "unpause_physics", &Services::unpause_physics);
  advertise("reset_world", &Services::reset_world);
  advertise("reset_simulation", &Services::reset_simulation);
  advertise_on(handles.steps, "step", &Services::step);
  advertise_on(handles.queries, "get_world_properties", &Services::get_world_properties);
  motor_bias_ = handles.edits.subscribe("motor_bias", 100, &Services::on_motor_bias, this);
}

bool Services::add_body(AddBodyRequest& request, AddBodyResponse& response) {
  return answer_edit(stepper_, response,
                     [&](World& world) { world.add_body(from_msg(request.body)); });
}

bool Services::remove_body(RemoveBodyRequest& request, RemoveBodyResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    response.removed_constraints = world.remove_body(find_own_body(world, "name", request.name));
  });
}

bool Services::add_distance_constraint(AddDistanceConstraintRequest& request,
                                       AddDistanceConstraintResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    const engine::JointId id = world.add_joint(from_msg(request, world));
    response.initial_error = finite(world.joint_state(id).initial_error);
    response.status_message = engine::text_of_opening(world, id);
  });
}

bool Services::add_constraint(AddConstraintRequest& request, AddConstraintResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    const engine::JointId id = world.add_joint(from_msg(request.constraint, world));
    response.initial_error = finite(world.joint_state(id).initial_error);
    response.status_message = engine::text_of_opening(world, id);
  });
}

bool Services::remove_constraint(RemoveConstraintRequest& request,
                                 RemoveConstraintResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    world.remove_joint(find_joint(world, "name", request.name));
  });
}

bool Services::set_motor_bias(SetMotorBiasRequest& request, SetMotorBiasResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    set_bias(world, request.constraint, request.bias, request.max_force, request.timeout);
  });
}

bool Services::set_constraint_properties(SetConstraintPropertiesRequest& request,
                                         SetConstraintPropertiesResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    const engine::JointId id = find_joint(world, "name", request.name);
    engine::Joint joint = world.joint(id);
    change_properties(request.keys, request.values, &joint);
    world.set_joint(id, joint);
    response.status_message = engine::text_of_opening(world, id);
  });
}

void Services::on_motor_bias(const MotorBias& message) {
  const auto change = [this, message](World& world) {
    try {
      set_bias(world, message.constraint, message.bias, message.max_force, message.timeout);
    } catch (const std::invalid_argument& error) {
      tell_of_motor(error.what());
    }
  };
  try {
    stepper_.post(change);
  } catch (const NotNow& error) {
    tell_of_motor(error.what());
  } catch (const Cancelled&) {
    // the node is going down, and the motor with it
  }
}

// at most once a second of the wall: simulated time may stand
void Services::tell_of_motor(const char* why) {
  const double now = ros::SteadyTime::now().toSec();
  if (now < told_of_motor_ + 1.0) return;
  told_of_motor_ = now;
  ROS_WARN("motor_bias: %s", why);
}

bool Services::apply_body_wrench(ApplyBodyWrenchRequest& request,
                                 ApplyBodyWrenchResponse& response) {
  return answer_edit(stepper_, response,
                     [&](World& world) { world.add_wrench(from_msg(request, world)); });
}

bool Services::clear_body_wrenches(ClearBodyWrenchesRequest& request,
                                   ClearBodyWrenchesResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    world.clear_wrenches(find_own_body(world, "body_name", request.body_name));
  });
}

bool Services::get_body_state(GetBodyStateRequest& request, GetBodyStateResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) {
      const engine::BodyId body = find_own_body(world, "name", request.name);
      const engine::BodyId frame = find_body(world, "reference_frame", request.reference_frame);
      response.state =
          to_msg(world.body(body).name, relative_to(world.state(frame), world.state(body)));
      response.header.frame_id = frame == engine::kWorldBody
                                     ? parameters_.world_frame
                                     : parameters_.frame_prefix + request.reference_frame;
      response.header.stamp = publishers_.stamp(world);
    });
  });
}

bool Services::set_body_state(SetBodyStateRequest& request, SetBodyStateResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    const engine::BodyId body = find_own_body(world, "name", request.state.name);
    const engine::BodyId frame = find_body(world, "reference_frame", request.reference_frame);
    const engine::BodyState state = from_msg(request.state.pose, request.state.twist);
    engine::validate(state);
    world.set_state(body, from_relative(world.state(frame), state));
  });
}

bool Services::load_scene(LoadSceneRequest& request, LoadSceneResponse& response) {
  return answer(response, [&] {
    if (request.path.empty() == request.text.empty())
      throw std::invalid_argument("path, text: exactly one of the two is needed, got path '" +
                                  shortened(request.path, 200) + "' and " +
                                  std::to_string(request.text.size()) + " characters of text");
    World scene = load_world(request.path, request.text, parameters_, Caller::kService);
    const std::string loaded = summary(scene);
    const Boundary boundary = stepper_.interrupt("load_scene", [&](World& world) {
      scene.continue_from(world);
      world = std::move(scene);
    });
    ROS_INFO("load_scene %s: %s",
             request.path.empty() ? "of a text" : shortened(request.path, 200).c_str(),
             loaded.c_str());
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
  });
}

bool Services::save_scene(SaveSceneRequest& request, SaveSceneResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) { response.text = engine::save_scene(world); });
    if (response.text.size() > kMostBytes) {
      const std::string size = std::to_string(response.text.size());
      response.text.clear();
      throw std::invalid_argument("the scene would be " + size + " bytes long, and no more than " +
                                  std::to_string(kMostBytes >> 20) + " MiB are loaded again");
    }
    if (request.path.empty()) return;
    const std::string& folder = parameters_.scene_folder;
    write_file(folder.empty() ? request.path : path_below(folder, request.path), response.text);
  });
}

bool Services::pause_physics(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  return done("pause_physics", [&] { stepper_.pause(); });
}

bool Services::unpause_physics(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  return done("unpause_physics", [&] {
    stepper_.unpause();
    if (stepper_.has_failed())
      ROS_WARN(
          "unpause_physics: the world stands until it is edited or reset, since the physics "
          "failed: %s",
          stepper_.failure().c_str());
  });
}

bool Services::reset_world(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  return done("reset_world",
              [&] { stepper_.interrupt("reset_world", [](World& world) { world.reset(); }); });
}

bool Services::reset_simulation(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  return done("reset_simulation", [&] {
    stepper_.interrupt("reset_simulation", [](World& world) {
      world.reset();
      world.set_time(0.0, 0);
    });
  });
}

// also where it is cancelled or fails, bodies and hash are those of the steps that were taken
bool Services::step(StepRequest& request, StepResponse& response) {
  const auto look = [&](const World& world) {
    response.bodies.clear();
    for (const engine::BodyId id : world.body_ids())
      response.bodies.push_back(to_msg(world.body(id).name, world.state(id)));
    response.state_hash = world.state_hash();
  };
  try {
    stepper_.step(request.steps, look);
    response.success = true;
  } catch (const std::exception& error) {
    response.status_message = error.what();
  }
  return true;
}

bool Services::get_world_properties(GetWorldPropertiesRequest&,
                                    GetWorldPropertiesResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) {
      response.sim_time = world.time();
      response.step = world.step_count();
      response.paused = stepper_.is_paused() || stepper_.has_failed();
      for (const engine::BodyId id : world.body_ids())
        response.bodies.push_back(world.body(id).name);
      for (const engine::JointId id : world.joint_ids())
        response.constraints.push_back(world.joint(id).name);
      response.time_step = world.options().time_step;
      response.gravity = to_vector(world.options().gravity);
      response.method = engine::name(world.options().method);
      response.state_hash = world.state_hash();
    });
  });
}

}  // namespace constraint_sim
