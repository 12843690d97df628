#pragma once

namespace constraint_sim::engine {

// What a method goes on from, beside what is compiled for an island, is said once, by its
// `static void visit_memory(Self& self, Visit& visit)`, `self` const where `visit` does not read.
// The hash of a world, and snapshots that are written and read, are the visitors:
//   visit(value)         all that decides the future, in an order that hashes go by
//   visit.beside(value)  what follows from other things, is known before them, or is only told: in
//                        snapshots and not in hashes
//   Visit::kReads        whether the values are set

}  // namespace constraint_sim::engine
