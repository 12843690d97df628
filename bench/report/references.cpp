#include "references.h"

#include <cmath>
#include <stdexcept>

#include "phases.h"
#include "problems.h"

namespace constraint_sim::report {
namespace {

using engine::problems::integrate;
/// Integrates y' = f(y) from sample to sample, in steps no longer than `step`.
template <class Derivative>
Trajectory integrated(int samples, double interval, double step, const Derivative& f, Reals y,
                      const std::function<States(const Reals&, int)>& states) {
  Trajectory trajectory{states(y, 0)};
  const int steps = std::max(1, static_cast<int>(std::ceil(interval / step * (1.0 - 1e-9))));
  for (int k = 1; k <= samples; ++k) {
    y = integrate(f, y, static_cast<Real>(interval), steps);
    trajectory.push_back(states(y, k));
  }
  return trajectory;
}

double to_double(Real x) { return static_cast<double>(x); }

/// Angles and rates of a chain. With u_i the direction of link i and T_i its tension,
///   m_k a_k = m_k g − T_k u_k + T_{k+1} u_{k+1},   u_i·(a_i − a_{i−1}) = −l_i φ̇_i²
/// is a tridiagonal system for T, and φ̈_i = n_i·(a_i − a_{i−1}) / l_i, n_i ⊥ u_i.
class ChainRates {
 public:
  explicit ChainRates(const PlanarChain& chain) : chain_(chain) {}

  Reals operator()(const Reals& y) const {
    const std::size_t n = chain_.masses.size();
    const Real g = static_cast<Real>(chain_.gravity);
    Reals c(n), s(n), diagonal(n), lower(n), upper(n), T(n);
    for (std::size_t i = 0; i < n; ++i) {
      c[i] = std::cos(y[i]);
      s[i] = std::sin(y[i]);
    }
    const auto inverse_mass = [&](std::size_t i) {
      return 1 / static_cast<Real>(chain_.masses[i]);
    };
    for (std::size_t i = 0; i < n; ++i) {
      diagonal[i] = -inverse_mass(i) - (i > 0 ? inverse_mass(i - 1) : 0);
      lower[i] = i > 0 ? inverse_mass(i - 1) * (c[i] * c[i - 1] + s[i] * s[i - 1]) : 0;
      upper[i] = i + 1 < n ? inverse_mass(i) * (c[i] * c[i + 1] + s[i] * s[i + 1]) : 0;
      T[i] = -static_cast<Real>(chain_.lengths[i]) * y[n + i] * y[n + i] + (i == 0 ? g * s[0] : 0);
    }
    for (std::size_t i = 1; i < n; ++i) {
      const Real factor = lower[i] / diagonal[i - 1];
      diagonal[i] -= factor * upper[i - 1];
      T[i] -= factor * T[i - 1];
    }
    for (std::size_t i = n; i-- > 0;)
      T[i] = (T[i] - (i + 1 < n ? upper[i] * T[i + 1] : 0)) / diagonal[i];

    Reals rate(2 * n);
    Real x_before = 0, z_before = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Real next = i + 1 < n ? T[i + 1] : 0;
      const Real x = inverse_mass(i) * (-T[i] * c[i] + (i + 1 < n ? next * c[i + 1] : 0));
      const Real z = inverse_mass(i) * (-T[i] * s[i] + (i + 1 < n ? next * s[i + 1] : 0)) - g;
      rate[i] = y[n + i];
      rate[n + i] =
          (-s[i] * (x - x_before) + c[i] * (z - z_before)) / static_cast<Real>(chain_.lengths[i]);
      x_before = x;
      z_before = z;
    }
    return rate;
  }

 private:
  PlanarChain chain_;
};

States chain_states(const PlanarChain& chain, const Reals& y) {
  const std::size_t n = chain.masses.size();
  States states(n);
  Real x = 0, z = 0, vx = 0, vz = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const Real length = static_cast<Real>(chain.lengths[i]);
    x += length * std::cos(y[i]);
    z += length * std::sin(y[i]);
    vx -= length * std::sin(y[i]) * y[n + i];
    vz += length * std::cos(y[i]) * y[n + i];
    states[i].position = {to_double(x), 0.0, to_double(z)};
    states[i].velocity = {to_double(vx), 0.0, to_double(vz)};
  }
  return states;
}

Reals start_of(const PlanarChain& chain) {
  Reals y(chain.angles.begin(), chain.angles.end());
  y.insert(y.end(), chain.rates.begin(), chain.rates.end());
  return y;
}

using Vector = Eigen::Matrix<Real, 3, 1>;
using Quaternion = Eigen::Quaternion<Real>;

}  // namespace

std::function<Trajectory(int)> closed_form(const Problem& problem,
                                           const std::function<States(long double)>& states) {
  const int samples = problem.samples();
  const double interval = problem.sample;
  return [=](int) {
    Trajectory trajectory;
    for (int k = 0; k <= samples; ++k)
      trajectory.push_back(states(static_cast<Real>(k) * static_cast<Real>(interval)));
    return trajectory;
  };
}

void add_chain(const PlanarChain& chain, Problem* problem) {
  const States states = chain_states(chain, start_of(chain));
  const int first = static_cast<int>(problem->bodies.size());
  for (std::size_t i = 0; i < states.size(); ++i) {
    Body body;
    body.mass = chain.masses[i];
    body.start = states[i];
    problem->bodies.push_back(body);
    Joint rod;
    rod.a = i == 0 ? kWorld : first + static_cast<int>(i) - 1;
    rod.b = first + static_cast<int>(i);
    rod.length = chain.lengths[i];
    problem->joints.push_back(rod);
  }
}

std::function<Trajectory(int)> chain_motion(const Problem& problem, const PlanarChain& chain,
                                            double step) {
  const int samples = problem.samples();
  const double interval = problem.sample;
  return [=](int refinement) {
    return integrated(samples, interval, step / refinement, ChainRates(chain), start_of(chain),
                      [&](const Reals& y, int) { return chain_states(chain, y); });
  };
}

Phase swing(const PlanarChain& chain) {
  Phase phase;
  phase.rates = ChainRates(chain);
  phase.states = [chain](const Reals& y) { return chain_states(chain, y); };
  return phase;
}

std::function<Trajectory(int)> rigid_motion(const Problem& problem, bool is_free,
                                            const Eigen::Vector3d& pivot, double step) {
  const Body body = problem.bodies.front();
  const int samples = problem.samples();
  const double interval = problem.sample;
  const Eigen::Vector3d gravity = problem.gravity;
  return [=](int refinement) {
    const Real mass = static_cast<Real>(body.mass);
    const Vector arm = is_free ? Vector::Zero() : Vector(-pivot.cast<Real>());  // pivot to centre
    const Vector g = gravity.cast<Real>();
    Eigen::Matrix<Real, 3, 3> I = body.inertia.cast<Real>().asDiagonal();
    I += mass * (arm.squaredNorm() * Eigen::Matrix<Real, 3, 3>::Identity() - arm * arm.transpose());
    const Eigen::Matrix<Real, 3, 3> inverse = I.inverse();
    const auto unpack = [](const Reals& y) {
      return std::make_pair(Quaternion(y[0], y[1], y[2], y[3]), Vector(y[4], y[5], y[6]));
    };
    const auto rates = [&](const Reals& y) {
      const auto [q, w] = unpack(y);
      const Vector torque = mass * arm.cross(q.normalized().conjugate() * g);
      const Vector dw = inverse * (torque - w.cross(Vector(I * w)));
      const Quaternion dq = q * Quaternion(0, w.x() / 2, w.y() / 2, w.z() / 2);
      return Reals{dq.w(), dq.x(), dq.y(), dq.z(), dw.x(), dw.y(), dw.z()};
    };
    const Quaternion q0 = body.start.orientation.cast<Real>();
    const Vector w0 = q0.conjugate() * body.start.angular_velocity.cast<Real>();
    const Vector x0 = body.start.position.cast<Real>();
    const Vector v0 = body.start.velocity.cast<Real>();
    const Vector fixed = x0 - q0 * arm;
    return integrated(
        samples, interval, step / refinement, rates,
        {q0.w(), q0.x(), q0.y(), q0.z(), w0.x(), w0.y(), w0.z()}, [&](const Reals& y, int k) {
          auto [q, w] = unpack(y);
          q.normalize();
          const Real t = static_cast<Real>(k) * static_cast<Real>(interval);
          const Vector w_W = q * w;
          State state;
          state.orientation = q.cast<double>();
          state.angular_velocity = w_W.cast<double>();
          const Vector x = is_free ? Vector(x0 + t * v0 + t * t / 2 * g) : Vector(fixed + q * arm);
          const Vector v = is_free ? Vector(v0 + t * g) : Vector(w_W.cross(q * arm));
          state.position = x.cast<double>();
          state.velocity = v.cast<double>();
          return States{state};
        });
  };
}

namespace {

engine::Joint axes_of(const Problem& problem, std::size_t j, bool with_couplings) {
  const Joint& joint = problem.joints[j];
  const auto id = [](int body) { return engine::BodyId{static_cast<std::uint32_t>(body + 1)}; };
  engine::Joint made;
  made.kind = has_axes(joint.kind) ? *engine::joint_kind_named(name(joint.kind))
                                   : engine::JointKind::kFreeDistance;
  made.body_a = id(joint.a);
  made.body_b = id(joint.b);
  made.anchor_a = joint.anchor_a;
  made.anchor_b = joint.anchor_b;
  made.frame_a = joint.frame_a;
  made.frame_b = joint.frame_b;
  const Coupling* screw = problem.screw_of(j);
  if (!with_couplings || screw == nullptr) return made;
  made.kind = engine::JointKind::kScrew;
  made.pitch = screw->pitch();
  return made;
}

}  // namespace

engine::reference::Scene axes_of(const Problem& problem, bool with_couplings) {
  engine::reference::Scene scene;
  scene.options.gravity = problem.gravity;
  for (const Body& body : problem.bodies) {
    engine::Body added;
    added.type = body.is_static ? engine::BodyType::kStatic : engine::BodyType::kDynamic;
    added.mass = body.mass;
    added.inertia = body.inertia;
    added.state = {body.start.position, body.start.orientation, body.start.velocity,
                   body.start.angular_velocity};
    scene.bodies.push_back(added);
    if (body.force.isZero(0.0)) continue;
    engine::Wrench push;
    push.body.value = static_cast<std::uint32_t>(scene.bodies.size());
    push.force = body.force;
    scene.wrenches.push_back(push);
  }
  std::vector<engine::JointId> ids(problem.joints.size());  // ids from 1, in the order of joints
  for (std::size_t j = 0; j < problem.joints.size(); ++j) {
    const JointKind kind = problem.joints[j].kind;
    if (!has_axes(kind) && kind != JointKind::kFreeLength) continue;
    scene.joints.push_back(axes_of(problem, j, with_couplings));
    ids[j].value = static_cast<std::uint32_t>(scene.joints.size());
  }
  for (const Coupling& coupling : problem.couplings) {
    if (!with_couplings || coupling.is_screw()) continue;
    engine::Joint added;
    const auto first = static_cast<std::size_t>(coupling.first);
    added.kind = problem.joints[first].kind == JointKind::kFreeLength ? engine::JointKind::kPulley
                                                                      : engine::JointKind::kGear;
    added.coupling.first = ids[first];
    added.coupling.second = ids[static_cast<std::size_t>(coupling.second)];
    added.coupling.ratio = coupling.ratio;
    scene.joints.push_back(added);
  }
  return scene;
}

std::function<Trajectory(int)> mechanism_motion(const Problem& problem) {
  const int samples = problem.samples();
  const double interval = problem.sample;
  return [=, scene = axes_of(problem, true)](int refinement) {
    constexpr long kMostEvaluations = 3000000;
    const engine::reference::Mechanics mechanics(scene);
    engine::reference::Integrator integrator(mechanics, refinement == 1 ? 1e-12 : 1e-15,
                                             kMostEvaluations);
    Trajectory trajectory;
    for (int k = 0; k <= samples; ++k) {
      integrator.advance_to(k * interval);
      if (!integrator.is_valid()) throw std::runtime_error("the reference does not get on");
      States& states = trajectory.emplace_back();
      for (const engine::reference::Pose& pose : integrator.poses())
        states.push_back({(pose.x + mechanics.origin()).cast<double>(), pose.q.cast<double>(),
                          pose.v.cast<double>(), pose.w.cast<double>()});
    }
    return trajectory;
  };
}

std::function<Trajectory(int)> one_angle(
    const Problem& problem, double a, double b, double angle, double rate, double step,
    const std::function<States(long double, long double)>& states) {
  const int samples = problem.samples();
  const double interval = problem.sample;
  return [=](int refinement) {
    const auto rates = [&](const Reals& y) {
      return Reals{y[1],
                   static_cast<Real>(a) * std::cos(y[0]) + static_cast<Real>(b) * std::sin(y[0])};
    };
    return integrated(samples, interval, step / refinement, rates,
                      {static_cast<Real>(angle), static_cast<Real>(rate)},
                      [&](const Reals& y, int) { return states(y[0], y[1]); });
  };
}

}  // namespace constraint_sim::report
