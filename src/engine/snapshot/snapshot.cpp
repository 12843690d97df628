#include "constraint_sim/engine/snapshot.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "engine/constraints/custom_code.h"
#include "engine/islands/method_choice.h"
#include "engine/math/fnv1a.h"
#include "engine/math/list.h"
#include "engine/model/fields.h"
#include "engine/model/shape_names.h"
#include "engine/snapshot/snapshot_checks.h"
#include "engine/snapshot/snapshot_fields.h"
#include "engine/support/memory.h"
#include "engine/world/next_islands.h"

namespace constraint_sim::engine {
namespace {

// Returns the first line of a snapshot. Another format, compiler or Eigen makes other bits.
const std::string& build() {
  static const std::string kBuild =
      "constraint_sim snapshot 15, compiled by " __VERSION__ " with Eigen " +
      std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
      std::to_string(EIGEN_MINOR_VERSION) + "\n";
  return kBuild;
}

template <class T, class = void>
struct IsTied : std::false_type {};
template <class T>
struct IsTied<T, std::void_t<decltype(fields(std::declval<T&>(), Of<std::remove_const_t<T>>{}))>>
    : std::true_type {};

/// Number of enumerators of an enum in snapshots.
template <class Enum>
constexpr long kCount = 0;
template <>
constexpr long kCount<Method> = kMethodCount;
template <>
constexpr long kCount<JointKind> = kJointKindCount;
template <>
constexpr long kCount<BodyType> = static_cast<long>(BodyType::kKinematic) + 1;
template <>
constexpr long kCount<Failure> = static_cast<long>(Failure::kCustom) + 1;
template <>
constexpr long kCount<MethodReason> = static_cast<long>(MethodReason::kOverlap) + 1;
template <>
constexpr long kCount<Hold> = static_cast<long>(Hold::kBrake) + 1;
template <>
constexpr long kCount<Servo> = static_cast<long>(Servo::kRetracts) + 1;
template <>
constexpr long kCount<ContactState> = static_cast<long>(ContactState::kSlipping) + 1;
template <>
constexpr long kCount<ImplicitMode> = static_cast<long>(ImplicitMode::kDissipate) + 1;

/// Visits values of all types in snapshots, down to numbers, and passes each number to
/// bytes(&number, size). Bytes::kReads: bytes are read into the values, with the sizes of lists.
template <class Bytes>
class Visitor {
 public:
  static constexpr bool kReads = Bytes::kReads;

  explicit Visitor(Bytes bytes) : bytes_(std::move(bytes)) {}
  Bytes& bytes() { return bytes_; }

  template <class T>
  void beside(T& value) {
    (*this)(value);
  }

  /// Whether the memory of a method follows. Lists that are read, and are not empty, must keep
  /// their sizes there, since compiled data depend on these sizes; empty lists take the size that
  /// is read. Equations of extreme numbers may leave NaN there, with which a step fails.
  void begin_method(bool begins) { is_of_method_ = begins; }
  const MostIds& most_ids() const { return most_ids_; }

  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_same_v<std::remove_const_t<T>, bool>)
      visit_flag(value);
    else if constexpr (std::is_enum_v<T>)
      visit_enum(value);
    else if constexpr (std::is_arithmetic_v<T>)
      visit_number(value);
    else if constexpr (kHasFields<std::remove_const_t<T>>)
      engine::visit_fields(value, [this](const char*, auto& field, auto) { (*this)(field); });
    else if constexpr (IsTied<T>::value)
      visit_tied(value);
    else
      visit(value);
  }

 private:
  /// `T` for a reader, const `T` for a writer.
  template <class T>
  using Value = std::conditional_t<kReads, T, const T>;

  template <class T>
  void visit_tied(T& value) {
    using Struct = std::remove_const_t<T>;
    // A report has NaN for an estimate that does not exist.
    constexpr bool kIsReport = std::is_same_v<Struct, StepReport> || std::is_same_v<Struct, Island>;
    const bool was_report = std::exchange(is_report_, is_report_ || kIsReport);
    std::apply([this](auto&... field) { ((*this)(field), ...); }, fields(value, Of<Struct>{}));
    is_report_ = was_report;
  }

  // Checks a byte before it becomes a bool.
  template <class T>
  void visit_flag(T& flag) {
    auto byte = static_cast<unsigned char>(flag);
    bytes_(&byte, sizeof byte);
    if constexpr (!kReads) return;
    if (byte > 1) fail_damaged("a flag");
    if constexpr (!std::is_const_v<T>) flag = byte == 1;
  }
  template <class T>
  void visit_enum(T& value) {
    using Enum = std::remove_const_t<T>;
    static_assert(kCount<Enum> > 0, "list the new type above");
    auto number = static_cast<std::underlying_type_t<Enum>>(value);
    bytes_(&number, sizeof number);
    if constexpr (!kReads) return;
    if (static_cast<long>(number) < 0 || static_cast<long>(number) >= kCount<Enum>)
      fail_damaged("a choice");
    if constexpr (!std::is_const_v<T>) value = static_cast<Enum>(number);
  }
  template <class T>
  void visit_number(T& number) {
    bytes_(&number, sizeof number);
    if constexpr (kReads && std::is_floating_point_v<T>)
      if (std::isnan(number) && !is_report_ && !is_of_method_) fail_damaged("a number");
  }
  template <class Tag>
  void visit(Id<Tag>& id) {
    (*this)(id.value);
    std::uint32_t& most = std::is_same_v<Id<Tag>, BodyId> ? most_ids_.body : most_ids_.joint;
    // Joints that couple no joints have the id 0 there, which need not exist.
    if (id.value > 0) most = std::max(most, id.value + 1);
    if (id.value == std::numeric_limits<std::uint32_t>::max()) fail_damaged("an id");
  }
  template <class Tag>
  void visit(const Id<Tag>& id) {
    (*this)(id.value);
  }
  void visit(Value<std::string>& text) {
    std::size_t size = text.size();
    (*this)(size);
    if constexpr (kReads) text.resize(bytes_.checked(size));
    if (size > 0) bytes_(&text[0], size);
  }
  void visit(Value<WorldOptions>& options) {
    visit_options(options, [this](const OptionInfo&, auto& value, auto) { (*this)(value); });
  }
  void visit(Value<Shape>& shape) {
    visit_kind(shape);
    if (auto* compound = std::get_if<Compound>(&shape)) return visit_parts(*compound);
    visit_dimensions(shape);
  }
  // Visits the number of the kind of a shape, and makes a shape of this kind.
  void visit_kind(Value<Shape>& shape) {
    std::size_t index = shape.index();
    (*this)(index);
    if constexpr (kReads) {
      if (index >= std::variant_size_v<Shape>) fail_damaged("a shape");
      shape = shape_of_kind(index);
    }
  }
  void visit_dimensions(Value<Shape>& shape) {
    std::visit(
        [this](auto& of_kind) {
          using Kind = std::decay_t<decltype(of_kind)>;
          if constexpr (std::is_same_v<Kind, Compound>)
            fail_damaged("a part of a shape");  // a part that has parts
          else
            (*this)(of_kind);
        },
        shape);
  }
  void visit_parts(Value<Compound>& compound) {
    Compound::Parts parts;
    if constexpr (!kReads) parts = *compound.parts;
    std::size_t count = parts.size();
    (*this)(count);
    if constexpr (kReads) parts.resize(bytes_.checked(count));
    for (ShapePart& part : parts) {
      visit_kind(part.shape);
      visit_dimensions(part.shape);
      (*this)(part.pose);
      (*this)(part.friction);
      (*this)(part.restitution);
    }
    if constexpr (!kReads) return;
    try {
      if constexpr (kReads) compound = Compound(std::move(parts));
    } catch (const std::invalid_argument&) {
      fail_damaged("a compound");
    }
  }
  void visit(Value<std::shared_ptr<const ConvexHull>>& surface) {
    std::vector<Eigen::Vector3d> vertices;
    if constexpr (!kReads) vertices = surface->vertices();
    (*this)(vertices);
    if constexpr (kReads) {
      try {
        surface = std::make_shared<const ConvexHull>(vertices);
      } catch (const std::invalid_argument&) {
        fail_damaged("a hull");
      }
      if (surface->vertices() != vertices) fail_damaged("a hull");
    }
  }
  template <class Scalar, int kRows, int kColumns, int kOptions>
  void visit(Eigen::Matrix<Scalar, kRows, kColumns, kOptions>& matrix) {
    bytes_(matrix.data(), sizeof(Scalar) * kRows * kColumns);
    if constexpr (kReads)
      if (matrix.hasNaN()) fail_damaged("a number");
  }
  template <class Scalar, int kRows, int kColumns, int kOptions>
  void visit(const Eigen::Matrix<Scalar, kRows, kColumns, kOptions>& matrix) {
    bytes_(matrix.data(), sizeof(Scalar) * kRows * kColumns);
  }
  void visit(Value<Eigen::Quaterniond>& q) { visit(q.coeffs()); }
  // Structured bindings name all fields, so a new field does not compile. Only `count` points
  // exist.
  void visit(Value<TouchingPair>& pair) {
    auto& [a, b, id_a, id_b, part_a, part_b, manifold, impulses, contact_states] = pair;
    auto& [normal, count, points] = manifold;
    (*this)(a);
    (*this)(b);
    (*this)(id_a);
    (*this)(id_b);
    (*this)(part_a);
    (*this)(part_b);
    (*this)(normal);
    (*this)(count);
    if (count < 0 || static_cast<std::size_t>(count) > points.size()) fail_damaged("its contacts");
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      (*this)(points[i]);
      (*this)(impulses[i]);
      (*this)(contact_states[i]);
    }
  }
  void visit(Value<PrescribedMotion>& motion) {
    PrescribedMotionVisitor visitor{this, 0};
    PrescribedMotion::visit_memory(motion, visitor);
  }
  void visit(Value<FreeRotation>& rotation) { FreeRotation::visit_memory(rotation, *this); }
  template <class T, std::size_t kSize>
  void visit(std::array<T, kSize>& list) {
    for (T& element : list) (*this)(element);
  }
  template <class T, std::size_t kSize>
  void visit(const std::array<T, kSize>& list) {
    for (const T& element : list) (*this)(element);
  }
  template <class T>
  void visit(std::vector<T>& list) {
    visit_list(list);
  }
  template <class T>
  void visit(const std::vector<T>& list) {
    visit_list(list);
  }
  template <class Container>
  void visit_list(Container& list) {
    std::size_t size = list.size();
    (*this)(size);
    if constexpr (kReads) {
      if (is_of_method_ && !list.empty() && size != list.size()) fail_damaged("the size of a list");
      list.resize(bytes_.checked(size));
    }
    for (std::size_t i = 0; i < size; ++i) {
      if constexpr (std::is_same_v<std::remove_const_t<Container>, std::vector<bool>>) {
        bool flag = list[i];
        (*this)(flag);
        if constexpr (kReads) list[i] = flag;
      } else {
        (*this)(list[i]);
      }
    }
  }
  template <class T>
  void visit(std::optional<T>& value) {
    visit_optional(value);
  }
  template <class T>
  void visit(const std::optional<T>& value) {
    visit_optional(value);
  }
  template <class Optional>
  void visit_optional(Optional& value) {
    bool is_there = value.has_value();
    (*this)(is_there);
    if constexpr (kReads) {
      value.reset();
      if (is_there) value.emplace();
    }
    if (is_there) (*this)(*value);
  }

  /// Visits a prescribed motion, and checks its numbers of coordinates and rows of the joint.
  struct PrescribedMotionVisitor {
    static constexpr bool kReads = Bytes::kReads;
    Visitor* all;
    std::size_t coordinates;  ///< number of coordinates; read before the number of rows

    void beside(std::size_t& count) {
      (*all)(count);
      coordinates = count;
      if (count > kMaxCoordinates) fail_damaged("a prescribed motion");
    }
    void beside(int& rows) {
      (*all)(rows);
      if (rows < 0 || rows > kMaxJointRows - static_cast<int>(coordinates))
        fail_damaged("a prescribed motion");
    }
    template <class T>
    void beside(T& value) {
      (*all)(value);
    }
  };

  Bytes bytes_;
  bool is_of_method_ = false;  // within the memory of a method
  bool is_report_ = false;     // within a StepReport or an Island
  MostIds most_ids_;
};

struct WrittenBytes {
  static constexpr bool kReads = false;
  std::string text;

  void operator()(const void* data, std::size_t size) {
    text.append(static_cast<const char*>(data), size);
  }
};

struct ReadBytes {
  static constexpr bool kReads = true;
  const std::string& text;
  std::size_t at;

  void operator()(void* data, std::size_t size) {
    checked(size);
    std::memcpy(data, text.data() + at, size);
    at += size;
  }
  /// Returns the size of a list; throws where fewer bytes are left than elements.
  std::size_t checked(std::size_t size) const {
    if (size > text.size() - at) throw SnapshotError("snapshot: is damaged, or cut off");
    return size;
  }
};

template <class Map, class Container, class Ids>
void name_all(const Container& list, const Ids& ids, Map* by_name) {
  by_name->clear();
  for (std::size_t i = 0; i < list.size(); ++i) by_name->emplace(list[i].name, ids[i]);
}

// Makes the code of plugin joints; throws SnapshotError where a plugin is missing.
void make_custom_codes(List<Joint>* joints) {
  for (Joint& joint : *joints) {
    if (!info(joint.kind).is_custom) continue;
    try {
      make_custom_code(&joint);
    } catch (const std::invalid_argument& refused) {
      throw SnapshotError(std::string("snapshot: ") + refused.what());
    }
  }
}

// Checks the indices in the results of the last step.
template <class Impl>
void check_rest(const Impl& impl) {
  if (impl.integration.rotations().size() > impl.bodies.size()) fail_damaged("its lists");
  // Joints added since the last step have no prescribed motion yet; their islands are fresh.
  for (std::size_t i = 0; i < impl.islands.size(); ++i) {
    const auto& parts = impl.island_parts[i];
    const bool is_smooth = !uses_impulses(impl.islands[i].method);
    if (!parts.is_fresh && is_smooth)
      check_indices(parts.members.joints, impl.integration.prescribed().size());
  }
  List<int> loaded;
  for (const AppliedWrench& load : impl.integration.loads()) loaded.push_back(load.body);
  check_indices(loaded, impl.bodies.size());
}

template <class Impl, class Visit>
void visit_world(Impl& impl, Visit& visit) {
  std::remove_const_t<Impl>::visit_memory(impl, visit);
}

}  // namespace

// Visits all data that outlive a step, in a world with compiled edits: first model and state, then,
// once a reader has compiled islands from these, the memory of islands and methods.
template <class Self, class Visit>
void World::Impl::visit_memory(Self& self, Visit& visit) {
  using ModelOf = std::conditional_t<Visit::kReads, Model, const Model>;
  using StateOf = std::conditional_t<Visit::kReads, State, const State>;
  using MemoryOf = std::conditional_t<Visit::kReads, IslandMemory, const IslandMemory>;
  visit(self.options);
  if constexpr (Visit::kReads) validate(self.options);
  visit(static_cast<ModelOf&>(self));
  visit(static_cast<StateOf&>(self));
  if constexpr (Visit::kReads) {
    check_model(self, self);
    check_ids(self, visit.most_ids());
    make_custom_codes(&self.joints);
    name_all(self.bodies, self.body_ids, &self.body_by_name);
    name_all(self.joints, self.joint_ids, &self.joint_by_name);
    const State state = self;
    self.rebuild_topology();
    static_cast<State&>(self) = state;
  }
  std::size_t count = self.islands.size();
  visit(count);
  if (count != self.islands.size()) throw SnapshotError("snapshot: has other islands");
  for (std::size_t i = 0; i < count; ++i) {
    auto& parts = self.island_parts[i];
    const BodyId first_body = self.islands[i].first_body;
    visit(self.islands[i]);
    if (self.islands[i].first_body != first_body) fail_damaged("an island");
    visit(static_cast<MemoryOf&>(parts));
    visit(parts.is_fresh);
    visit(parts.energy);
    visit(parts.has_limited_spring);
    // An island that impulses advance by its nature keeps the motion compiled for another method.
    // The next other method restarts this motion, and a reader could not compile it with these
    // options.
    const bool is_by_impulses = uses_impulses(method_for(parts.nature, self.options));
    bool has_motion = parts.motion >= 0 && !is_by_impulses;
    visit(has_motion);
    List<int> open_points;  // joints that were open when the island was compiled
    if (has_motion) open_points = parts.open_points;
    visit(open_points);
    if constexpr (Visit::kReads) check_indices(open_points, self.joints.size());
    if constexpr (Visit::kReads)
      if (has_motion && (parts.motion < 0 || open_points != parts.open_points))
        compile_island(self, self.topology, open_points, &parts, &self.motions);
    visit.begin_method(true);
    if (has_motion)
      IslandMotion::visit_memory(self.motions[static_cast<std::size_t>(parts.motion)], visit,
                                 self.masses);
    visit.begin_method(false);
  }
  IslandIntegration::visit_motion(self.integration, visit);
  ContactPipeline::visit_memory(self.pipeline, visit);
  Monitors::visit_energies(self.monitors, visit);
  Sleep::visit_memory(self.sleep, visit);
  if constexpr (Visit::kReads) {
    check_rest(self);
    self.list_fresh();
    self.integration.continue_from(self, self.topology, self.sleep.awake(), self, &self);
  }
  IslandIntegration::visit_choice(self.integration, visit);
  ContactGroups::visit_memory(self.groups, visit);
  IslandIntegration::visit_prescribed(self.integration, visit);
  visit(self.contacts);
  visit(self.resting_contact_count);
  Monitors::visit_memory(self.monitors, visit);
  visit(self.report);
  if constexpr (Visit::kReads) {
    check_indices(self.integration.time_varying_joints(),
                  std::min(self.joints.size(), self.integration.prescribed().size()));
    if (self.resting_contact_count > self.contacts.size()) fail_damaged("its contacts");
    check_ids(self, visit.most_ids());
    self.forget_unknown_ids();
  }
}

std::string write_snapshot(const World& world) {
  std::optional<WorldImpl> copy;
  const WorldImpl& impl = compiled(ImplAccess::of(world), &copy);
  Visitor<WrittenBytes> writer(WrittenBytes{build()});
  visit_world(impl, writer);
  const std::uint64_t hash = impl.hash();
  writer(hash);
  std::string& text = writer.bytes().text;
  const std::uint64_t sum = fnv1a(text.data(), text.size());
  writer(sum);
  return std::move(text);
}

bool is_snapshot(const std::string& bytes) { return bytes.compare(0, 24, build(), 0, 24) == 0; }

World read_world(const std::string& bytes, bool checks_sums) {
  const std::size_t start = build().size();
  std::uint64_t sum = 0;
  if (bytes.size() < start + sizeof sum) throw SnapshotError("snapshot: is cut off");
  const std::size_t end = bytes.size() - sizeof sum;
  std::memcpy(&sum, bytes.data() + end, sizeof sum);
  if (checks_sums && sum != fnv1a(bytes.data(), end))
    throw SnapshotError("snapshot: is damaged, or cut off");
  World world;
  Visitor<ReadBytes> reader(ReadBytes{bytes, start});
  std::uint64_t hash = 0;
  try {
    visit_world(ImplAccess::of(world), reader);
    reader(hash);
  } catch (const SnapshotError&) {
    throw;
  } catch (const std::invalid_argument& refused) {
    throw SnapshotError(std::string("snapshot: is damaged: ") + refused.what());
  }
  if (reader.bytes().at != end || (checks_sums && hash != world.state_hash()))
    throw SnapshotError("snapshot: its world cannot be made again by this build");
  return world;
}

World read_snapshot(const std::string& bytes) {
  const std::string& expected = build();
  if (bytes.compare(0, expected.size(), expected) != 0) {
    const std::size_t end = is_snapshot(bytes) ? bytes.find('\n') : 0;
    throw SnapshotError(end == 0 || end == std::string::npos
                            ? "snapshot: is none"
                            : "snapshot: is of another build: '" +
                                  bytes.substr(0, std::min<std::size_t>(end, 200)) +
                                  "', this is '" + expected.substr(0, expected.size() - 1) + "'");
  }
  return read_world(bytes, true);
}

}  // namespace constraint_sim::engine
