#include "engine/dynamics/implicit/couplings_in_step.h"

#include <cmath>

#include "engine/dynamics/implicit/general_links.h"

namespace constraint_sim::engine {

void CouplingsInStep::begin(const ImplicitModel& model, const List<LinkInStep>& links,
                            const EquationsOfMotion& equations, ImplicitSystem* system) {
  for (std::size_t c = 0; c < couplings_.size(); ++c) {
    Coupling& coupling = couplings_[c];
    const EquationsOfMotion::CoupledRow& from = equations.coupled_rows()[c];
    coupling.target =
        equations.coordinates().constant(c) + equations.inputs().coupling_offset(c).value;
    double sum = 0.0;
    for (std::size_t k = 0; k < 2; ++k) {
      const ImplicitCoupling::Term& term = model.couplings()[c].terms[k];
      const JointVectors vectors = links[term.link].start();
      coupling.start[k] = coupling.end[k] =
          reading(term.form, value(term.form, vectors), from.terms[k].zero,
                  equations.coordinates().term(c, k));
      const Jacobian J = jacobian(term.form, vectors);
      const double square = term.ratio * term.ratio;
      for (std::size_t e = 0; e < 2; ++e) {
        const ImplicitEnd& end = model.links()[term.link].ends[e];
        if (end.dofs == 0) continue;
        sum += square * J.j3.squaredNorm() / model.mass(end.point);
        if (end.dofs == 6)
          sum += square * (e == 0 ? J.j2 : J.j4).squaredNorm() / model.inertia(end.point).mean();
      }
    }
    coupling.scale = sum > 0.0 ? 1.0 / std::sqrt(sum) : 1.0;
    system->scale_row(model.couplings()[c].unknown, coupling.scale);
  }
}

void CouplingsInStep::evaluate(const ImplicitModel& model, const ImplicitMotion& motion,
                               const List<double>& unknowns, List<LinkInStep>* links,
                               ImplicitSystem* system) {
  for (std::size_t c = 0; c < couplings_.size(); ++c) {
    const ImplicitCoupling& row = model.couplings()[c];
    Coupling& coupling = couplings_[c];
    const double lambda = coupling.is_left_out ? 0.0 : unknowns[row.unknown];
    const double scale = coupling.is_left_out ? 0.0 : coupling.scale;
    double off = -coupling.target;
    ImplicitSystem::Entries entries = system->entries_of_coupling(c);
    for (std::size_t k = 0; k < 2; ++k) {
      const ImplicitCoupling::Term& term = row.terms[k];
      const ImplicitLink& link = model.links()[term.link];
      LinkInStep& state = (*links)[term.link];
      const JointInStep joint(link, state, motion, unknowns);
      const double force = term.ratio * lambda;
      const FormInStep form(term.form, joint, force);
      coupling.end[k] = form.end_of(term.form, joint, coupling.start[k]);
      off += term.ratio * coupling.end[k];
      for (std::size_t e = 0; e < 2; ++e) {
        const ImplicitEnd& end = link.ends[e];
        const Eigen::Vector3d torque = force * (e == 0 ? form.J.j2 : form.J.j4);
        add_load(end, force, form.J.j3, torque, motion, system);
        if (end.dofs == 6) state.swing[e] += torque.norm();
      }
      for (std::size_t e = 0; e < 2; ++e) {
        const ImplicitEnd& end = link.ends[e];
        if (end.dofs == 0) continue;
        write_slopes(link, e, motion, form.slopes, *system, &entries);
        const Eigen::Matrix<double, 6, 1> column = column_of(end, e, term.ratio, form.J, motion);
        for (int i = 0; i < end.dofs; ++i) {
          entries.add(system->left(end.unknown)[i] * column[i] * scale);
          entries.add(scale * term.ratio * form.gradient[e][i] * system->right(end.unknown)[i]);
        }
      }
    }
    if (!coupling.is_redundant) system->note_row(row.metres * std::abs(off), coupling.is_left_out);
    entries.add(coupling.is_left_out ? 1.0 : 0.0);
    system->set_residual(row.unknown, coupling.is_left_out ? 0.0 : off);
  }
}

void CouplingsInStep::finish(const ImplicitModel& model, double h, const List<double>& unknowns,
                             EquationsOfMotion* equations) const {
  for (std::size_t c = 0; c < couplings_.size(); ++c) {
    const Coupling& coupling = couplings_[c];
    if (!coupling.is_left_out)
      equations->forces().add_coupled(*equations, c, h * unknowns[model.couplings()[c].unknown]);
    for (std::size_t k = 0; k < 2; ++k) equations->coordinates().set_term(c, k, coupling.end[k]);
  }
}

}  // namespace constraint_sim::engine
