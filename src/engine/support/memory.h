#pragma once

namespace constraint_sim::engine {

// Memory of a method beyond the data compiled for an island, listed by its `static void
// visit_memory(Self& self, Visit& visit)`; `self` is const unless `visit` reads. Visitors are the
// hash of a world and the writer and reader of snapshots:
//   visit(value)         data that decides the future, in the order of the hash
//   visit.beside(value)  derived or reported data: in snapshots, not in hashes
//   Visit::kReads        whether the visitor sets the values

}  // namespace constraint_sim::engine
