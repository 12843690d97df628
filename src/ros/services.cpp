#include "ros/services.h"

#include <ros/console.h>
#include <std_msgs/String.h>

#include <type_traits>

#include "constraint_sim/engine/scene.h"
#include "ros/answer.h"
#include "ros/body_meshes.h"
#include "ros/conversions.h"
#include "ros/edits.h"
#include "ros/geometry_queries.h"
#include "ros/scenes.h"
#include "ros/time_conversions.h"
#include "sim/errors.h"
#include "sim/files.h"
#include "sim/words.h"

namespace constraint_sim {
Services::Services(Stepper& stepper, EditLog& edit_log, Publishers& publishers, Robots& robots,
                   const Parameters& parameters, ServiceHandles handles)
    : stepper_(stepper),
      edit_log_(edit_log),
      publishers_(publishers),
      robots_(robots),
      parameters_(parameters),
      snapshots_(stepper, edit_log, parameters, handles.edits, handles.queries) {
  const auto advertise_on = [&](ros::NodeHandle& handle, const char* name, auto handler) {
    servers_.push_back(guarded_service(handle, name, handler, this));
  };
  const auto advertise = [&](const char* name, auto handler) {
    advertise_on(handles.edits, name, handler);
  };
  advertise_on(handles.queries, "get_body_state", &Services::get_body_state);
  advertise_on(handles.queries, "cast_ray", &Services::cast_ray);
  advertise_on(handles.queries, "closest_points", &Services::closest_points);
  advertise_on(handles.queries, "bodies_in", &Services::bodies_in);
  visit_edits([&](const char* name, auto* service) {
    using Service = std::remove_pointer_t<decltype(service)>;
    servers_.push_back(guarded_service<typename Service::Request, typename Service::Response>(
        handles.edits, name, [this, name](auto& request, auto& response) {
          return this->edit(name, request, response);
        }));
  });
  advertise("load_scene", &Services::load_scene);
  advertise_on(handles.queries, "list_scenes", &Services::list_scenes);
  advertise("save_scene", &Services::save_scene);
  advertise_on(handles.pauses, "pause_physics", &Services::pause_physics);
  advertise_on(handles.pauses, "unpause_physics", &Services::unpause_physics);
  advertise("reset_world", &Services::reset_world);
  advertise("reset_simulation", &Services::reset_simulation);
  advertise_on(handles.steps, "step", &Services::step);
  advertise_on(handles.queries, "get_world_properties", &Services::get_world_properties);
  const SharedGuard guard = make_guard("motor_bias");
  motor_bias_ = guarded_subscribe<MotorBias>(
      handles.edits, guard, 100,
      [this, guard](const MotorBias& message) { set_motor_bias(message, guard); });
  scene_topic_ = handles.edits.advertise<std_msgs::String>("scene", 1, true);
  tell_scene(parameters.scene);
}

template <class Request, class Response>
bool Services::edit(const char* service, Request& request, Response& response) {
  return answer(response, [&] {
    if (stepper_.is_stopping()) throw Cancelled();  // meshes of waiting calls would take minutes
    const DividedMeshes meshes = divide_meshes(&request);
    const auto apply = [&](World& world) {
      change(world, request, &response);
      robots_.add(visuals_of(meshes, world), world);
      follow(request);
      edit_log_.record(stepper_, service, request, world);
    };
    const Boundary boundary = stepper_.edit(apply, duration_of(request));
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
    if (meshes.sentences.empty()) return;
    const std::string& further = response.status_message;
    response.status_message = meshes.sentences + (further.empty() ? "" : "; ") + further;
  });
}

SetOptionsResponse Services::set_options(SetOptionsRequest& request) {
  SetOptionsResponse response;
  edit("set_options", request, response);
  return response;
}

Stepper::Duration Services::duration_of(const ApplyEditsRequest& request) {
  constexpr std::size_t kFew = 100;
  return size(request) > kFew ? Stepper::Duration::kMayBeLong : Stepper::Duration::kShort;
}

void Services::follow(const SetOptionsRequest& request) {
  const Pacing asked = pacing(request);
  if (asked.real_time_factor) {
    stepper_.set_real_time_factor(*asked.real_time_factor);
    publishers_.set_real_time_factor(*asked.real_time_factor);
  }
  if (asked.publish_rate) publishers_.set_publish_rate(*asked.publish_rate);
}

bool Services::list_scenes(ListScenesRequest&, ListScenesResponse& response) {
  return answer(response, [&] {
    response.scenes = shipped_scenes();
    for (const std::string& scene : response.scenes)
      response.descriptions.push_back(description(scene));
  });
}

void Services::set_motor_bias(const MotorBias& message, const SharedGuard& guard) {
  guarded_post(stepper_, guard, [this, request = request_of(message)](World& world) {
    SetMotorBiasResponse response;
    change(world, request, &response);
    edit_log_.record(stepper_, "set_motor_bias", request, world);
  });
}

bool Services::get_body_state(GetBodyStateRequest& request, GetBodyStateResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) {
      const engine::BodyId body = find_own_body(world, "name", request.name);
      const engine::BodyId frame = find_body(world, "reference_frame", request.reference_frame);
      response.state =
          to_msg(world.body(body).name, relative_to(world.state(frame), world.state(body)));
      response.header = header_in(world, request.reference_frame);
    });
  });
}

bool Services::cast_ray(CastRayRequest& request, CastRayResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) {
      constraint_sim::cast_ray(world, request, &response);
      response.header = header_in(world, request.reference_frame);
    });
  });
}

bool Services::closest_points(ClosestPointsRequest& request, ClosestPointsResponse& response) {
  return answer(response, [&] {
    stepper_.inspect([&](const World& world) {
      constraint_sim::closest_points(world, request, &response);
      response.header = header_in(world, "world");
    });
  });
}

bool Services::bodies_in(BodiesInRequest& request, BodiesInResponse& response) {
  return answer(response, [&] {
    stepper_.inspect(
        [&](const World& world) { constraint_sim::bodies_in(world, request, &response); });
  });
}

std_msgs::Header Services::header_in(const World& world, const std::string& reference_frame) const {
  const bool is_world = reference_frame.empty() || reference_frame == "world";
  std_msgs::Header header;
  header.frame_id = is_world ? parameters_.world_frame : parameters_.frame_prefix + reference_frame;
  header.stamp = publishers_.stamp(world);
  return header;
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
      edit_log_.record_replaced(stepper_, world);
      publishers_.renew_markers();
    });
    ROS_INFO("load_scene %s: %s",
             request.path.empty() ? "of a text" : shortened(request.path, 200).c_str(),
             loaded.c_str());
    tell_scene(request.path);
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
  });
}

void Services::tell_scene(const std::string& path) {
  std_msgs::String message;
  message.data = path;
  scene_topic_.publish(message);
}

bool Services::save_scene(SaveSceneRequest& request, SaveSceneResponse& response) {
  return answer(response, [&] {
    World world;  // written on this thread, so that the stepping thread does not wait
    stepper_.inspect([&](const World& now) { world = now; });
    response.text = engine::save_scene(world);
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
  stepper_.pause();
  return true;
}

bool Services::unpause_physics(std_srvs::EmptyRequest&, std_srvs::EmptyResponse&) {
  stepper_.unpause();
  if (stepper_.has_failed())
    ROS_WARN(
        "unpause_physics: the world stands until it is edited or reset, since the physics "
        "failed: %s",
        stepper_.failure().c_str());
  return true;
}

bool Services::reset_world(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse&) {
  stepper_.interrupt("reset_world", [&](World& world) {
    constraint_sim::reset_world(world);
    edit_log_.record(stepper_, "reset_world", request, world);
    publishers_.renew_markers();
  });
  return true;
}

bool Services::reset_simulation(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse&) {
  stepper_.interrupt("reset_simulation", [&](World& world) {
    edit_log_.check(stepper_, world);
    constraint_sim::reset_simulation(world);
    edit_log_.record(stepper_, "reset_simulation", request, world);
    publishers_.renew_markers();
  });
  return true;
}

// Takes steps. The response has bodies and hash after the last step taken, also where the call is
// cancelled or fails.
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
  } catch (...) {
    response.status_message = message_of_exception();
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
