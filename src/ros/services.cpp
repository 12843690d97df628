#include "ros/services.h"

#include <exception>

#include "ros/conversions.h"

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

template <class Response, class Change>
bool answer_edit(Stepper& stepper, Response& response, Change change) {
  return answer(response, [&] {
    const Boundary boundary = stepper.edit(change);
    response.applied_at = ros::Time(boundary.time);
    response.step = boundary.step;
  });
}

}  // namespace

Services::Services(Stepper& stepper, const Parameters& parameters, ros::NodeHandle& private_handle)
    : stepper_(stepper), default_time_step_(parameters.time_step) {
  const auto advertise = [&](const char* name, auto handler) {
    servers_.push_back(private_handle.advertiseService(name, handler, this));
  };
  advertise("add_body", &Services::add_body);
  advertise("remove_body", &Services::remove_body);
  advertise("add_distance_constraint", &Services::add_distance_constraint);
  advertise("remove_constraint", &Services::remove_constraint);
  advertise("set_motor_bias", &Services::set_motor_bias);
  advertise("load_scene", &Services::load_scene);
  advertise("pause_physics", &Services::pause_physics);
  advertise("unpause_physics", &Services::unpause_physics);
  advertise("step", &Services::step);
  advertise("get_world_properties", &Services::get_world_properties);
}

bool Services::add_body(AddBodyRequest& request, AddBodyResponse& response) {
  return answer_edit(stepper_, response,
                     [&](World& world) { world.add_body(from_msg(request.body)); });
}

bool Services::remove_body(RemoveBodyRequest& request, RemoveBodyResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    response.removed_constraints = world.remove_body(find_body(world, "name", request.name));
  });
}

bool Services::add_distance_constraint(AddDistanceConstraintRequest& request,
                                       AddDistanceConstraintResponse& response) {
  return answer_edit(stepper_, response, [&](World& world) {
    const engine::JointId id = world.add_joint(from_msg(request, world));
    response.initial_error = world.joint_state(id).initial_error;
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
    const engine::JointId id = find_joint(world, "constraint", request.constraint);
    engine::Motor motor = world.joint(id).motor;
    motor.bias = request.bias;
    motor.max_force = request.max_force;
    motor.timeout = request.timeout;
    world.set_motor(id, motor);
  });
}

bool Services::load_scene(LoadSceneRequest& request, LoadSceneResponse& response) {
  return answer(response, [&] {
    if (request.path.empty() == request.text.empty())
      throw std::invalid_argument("path, text: exactly one of the two is needed, got path '" +
                                  request.path + "' and " + std::to_string(request.text.size()) +
                                  " characters of text");
    World scene = load_world(request.path, request.text, default_time_step_);
    const Boundary boundary = stepper_.edit([&](World& world) {
      scene.continue_from(world);
      world = std::move(scene);
    });
    response.applied_at = ros::Time(boundary.time);
    response.step = boundary.step;
  });
}

bool Services::pause_physics(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  stepper_.pause();
  return true;
}

bool Services::unpause_physics(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  stepper_.unpause();
  return true;
}

bool Services::step(StepRequest& request, StepResponse& response) {
  return answer(response, [&] {
    stepper_.step(request.steps, [&](const World& world) {
      for (const engine::BodyId id : world.body_ids())
        response.bodies.push_back(to_msg(world.body(id).name, world.state(id)));
      response.state_hash = world.state_hash();
    });
  });
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
