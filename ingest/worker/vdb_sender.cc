#include "ingest/worker/vdb_sender.h"

#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "engine/base/parallel.h"
#include "ingest/protocol.h"
#include "ingest/worker/to_float.h"

namespace fovea::ingest {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;

/// Goes through all of a tree inside a box: every tile and leaf, active or not, each once. Boxes
/// are clipped.
template <typename TreeT>
class TreeWalk {
 public:
  using LeafT = typename TreeT::LeafNodeType;
  using TopT = typename TreeT::RootNodeType::ChildNodeType;
  static constexpr bool kIsMask = std::is_same_v<typename TreeT::BuildType, openvdb::ValueMask>;

  /// `visitor` has Tile(box, value) and Leaf(leaf, box), which return a Status.
  template <typename Visitor>
  static Status Run(const TreeT& tree, const CoordBBox& clip, Visitor* visitor) {
    // 64 bits: the last cell may end beyond 2^31.
    const int64_t step = TopT::DIM;
    const Coord first = clip.min() & ~static_cast<int32_t>(TopT::DIM - 1);
    for (int64_t z = first.z(); z <= clip.max().z(); z += step) {
      for (int64_t y = first.y(); y <= clip.max().y(); y += step) {
        for (int64_t x = first.x(); x <= clip.max().x(); x += step) {
          const Coord at(static_cast<int32_t>(x), static_cast<int32_t>(y), static_cast<int32_t>(z));
          FOVEA_RETURN_IF_ERROR(VisitTop(tree, at, clip, visitor));
        }
      }
    }
    return absl::OkStatus();
  }

 private:
  static CoordBBox Clip(const Coord& origin, int64_t dim, const CoordBBox& clip) {
    CoordBBox box = CoordBBox::createCube(origin, static_cast<Coord::ValueType>(dim));
    box.intersect(clip);
    return box;
  }

  template <typename Visitor>
  static Status VisitTop(const TreeT& tree, const Coord& at, const CoordBBox& clip,
                         Visitor* visitor) {
    if (const TopT* node = tree.template probeConstNode<TopT>(at)) {
      return VisitNode(*node, clip, visitor);
    }
    return visitor->Tile(Clip(at, TopT::DIM, clip),
                         kIsMask ? tree.isValueOn(at) : tree.getValue(at));
  }

  /// The children that the clip reaches: a node has up to 32^3, and a small grid is in one of them.
  template <typename NodeT, typename Visitor>
  static Status VisitNode(const NodeT& node, const CoordBBox& clip, Visitor* visitor) {
    Coord first;
    Coord last;  // both in children from the node's origin
    for (int axis = 0; axis < 3; ++axis) {
      const int64_t lo = int64_t{clip.min()[axis]} - node.origin()[axis];
      const int64_t hi = int64_t{clip.max()[axis]} - node.origin()[axis];
      if (hi < 0 || lo >= int64_t{NodeT::DIM}) {
        return absl::OkStatus();
      }
      constexpr int64_t kChildDim = NodeT::ChildNodeType::DIM;
      first[axis] = static_cast<int32_t>(std::max<int64_t>(lo, 0) / kChildDim);
      last[axis] = static_cast<int32_t>(std::min<int64_t>(hi, NodeT::DIM - 1) / kChildDim);
    }
    Coord at;
    for (at.x() = first.x(); at.x() <= last.x(); ++at.x()) {
      for (at.y() = first.y(); at.y() <= last.y(); ++at.y()) {
        for (at.z() = first.z(); at.z() <= last.z(); ++at.z()) {
          FOVEA_RETURN_IF_ERROR(VisitChild(node, at, clip, visitor));
        }
      }
    }
    return absl::OkStatus();
  }

  template <typename NodeT, typename Visitor>
  static Status VisitChild(const NodeT& node, const Coord& at, const CoordBBox& clip,
                           Visitor* visitor) {
    using ChildT = typename NodeT::ChildNodeType;
    const auto i = static_cast<openvdb::Index>(
        (((at.x() << NodeT::LOG2DIM) + at.y()) << NodeT::LOG2DIM) + at.z());
    const CoordBBox box = Clip(node.offsetToGlobalCoord(i), ChildT::DIM, clip);
    if (box.empty()) {
      return absl::OkStatus();
    }
    if (!node.isChildMaskOn(i)) {
      return visitor->Tile(box, kIsMask ? node.isValueMaskOn(i) : node.getTable()[i].getValue());
    }
    if constexpr (ChildT::LEVEL == 0) {
      return visitor->Leaf(*node.getTable()[i].getChild(), box);
    } else {
      return VisitNode(*node.getTable()[i].getChild(), clip, visitor);
    }
  }
};

/// The values of leaves, as floats.
template <typename LeafT>
class LeafValues {
 public:
  explicit LeafValues(const LeafT& leaf) : leaf_(leaf) {
    if constexpr (kIsFloat) {
      values_ = leaf.buffer().data();
    }
  }

  /// Calls `visit(value)`, which returns whether to go on, for the values inside a box, x fastest.
  template <typename Visit>
  void ForEach(const CoordBBox& box, uint64_t* rounded, const Visit& visit) const {
    const Coord first = box.min() - leaf_.origin();
    const Coord last = box.max() - leaf_.origin();
    for (int z = first.z(); z <= last.z(); ++z) {
      for (int y = first.y(); y <= last.y(); ++y) {
        for (int x = first.x(); x <= last.x(); ++x) {
          if (!visit(At((((x << LeafT::LOG2DIM) + y) << LeafT::LOG2DIM) + z, rounded))) {
            return;
          }
        }
      }
    }
  }

  /// The value of all voxels inside a box, if they have one. NaN counts as different.
  [[nodiscard]] std::optional<float> Constant(const CoordBBox& box) const {
    uint64_t ignored = 0;
    std::optional<float> constant;
    bool is_constant = true;
    ForEach(box, &ignored, [&](float value) {
      constant = constant ? constant : value;
      is_constant = value == *constant;
      return is_constant;
    });
    return is_constant ? constant : std::nullopt;
  }

 private:
  static constexpr bool kIsFloat = std::is_same_v<typename LeafT::BuildType, float>;

  [[nodiscard]] float At(int offset, uint64_t* rounded) const {
    if constexpr (kIsFloat) {
      return values_[offset];
    } else {
      return ToFloat(leaf_.getValue(static_cast<openvdb::Index>(offset)), rounded);
    }
  }

  const LeafT& leaf_;
  const float* values_ = nullptr;  // of float leaves
};

/// How much of the extent each value fills in whole tiles and leaves.
template <typename LeafT>
class FillVote {
 public:
  explicit FillVote(float background) : background_(background) {}

  template <typename T>
  Status Tile(const CoordBBox& box, T value) {
    uint64_t rounded = 0;
    Count(ToFloat(value, &rounded), box);
    return absl::OkStatus();
  }
  Status Leaf(const LeafT& leaf, const CoordBBox& box) {
    if (const auto value = LeafValues<LeafT>(leaf).Constant(box)) {
      Count(*value, box);
    }
    return absl::OkStatus();
  }
  /// The winner; the background where nothing fills more.
  [[nodiscard]] float Winner() const {
    float winner = background_;
    double most = 0;
    for (const auto& [value, volume] : volumes_) {
      if (volume > most) {
        most = volume;
        winner = value;
      }
    }
    return winner;
  }

 private:
  void Count(float value, const CoordBBox& box) {
    constexpr size_t kMaxValues = 256;  // more candidates than a sensible grid has
    if (std::isfinite(value) && (volumes_.contains(value) || volumes_.size() < kMaxValues)) {
      volumes_[value] += static_cast<double>(box.volume());
    }
  }

  float background_;
  std::map<float, double> volumes_;
};

/// Sends all that differs from the fill.
template <typename LeafT>
class Sender {
 public:
  Sender(float fill, Channel* channel) : fill_(fill), channel_(channel) {}

  template <typename T>
  Status Tile(const CoordBBox& box, T value) {
    uint64_t inexact = 0;
    const float converted = ToFloat(value, &inexact);
    rounded_ += inexact * box.volume();
    return SendConstant(box, converted);
  }
  Status Leaf(const LeafT& leaf, const CoordBBox& box) {
    const LeafValues<LeafT> values(leaf);
    float* next = buffer_.data();
    values.ForEach(box, &rounded_, [&](float value) {
      *next++ = value;
      return true;
    });
    if (const auto constant = values.Constant(box)) {
      return SendConstant(box, *constant);
    }
    return channel_->Send(EncodeBlock(ToBox(box), {buffer_.data(), next}), Channel::kNoDeadline);
  }
  [[nodiscard]] uint64_t rounded() const { return rounded_; }

 private:
  Status SendConstant(const CoordBBox& box, float value) {
    if (value == fill_) {
      return absl::OkStatus();
    }
    return channel_->Send(Encode(fovea::ingest::Tile{ToBox(box), value}), Channel::kNoDeadline);
  }

  float fill_;
  Channel* channel_;
  uint64_t rounded_ = 0;
  std::array<float, LeafT::NUM_VALUES> buffer_;
};

template <typename GridT>
Status SendAs(const GridT& grid, uint32_t index, const Box3& extent, Channel* channel) {
  using TreeT = typename GridT::TreeType;
  using LeafT = typename TreeT::LeafNodeType;
  const auto coordinate = [](int64_t value) { return static_cast<int32_t>(value); };
  const CoordBBox clip(
      Coord(coordinate(extent.lo.x), coordinate(extent.lo.y), coordinate(extent.lo.z)),
      Coord(coordinate(extent.hi.x - 1), coordinate(extent.hi.y - 1), coordinate(extent.hi.z - 1)));
  uint64_t ignored = 0;
  FieldStart start{index, ToFloat(grid.background(), &ignored), 0};
  start.background = std::isfinite(start.background) ? start.background : 0.0F;
  FillVote<LeafT> vote(start.background);
  FOVEA_RETURN_IF_ERROR(TreeWalk<TreeT>::Run(grid.tree(), clip, &vote));
  start.fill = vote.Winner();
  FOVEA_RETURN_IF_ERROR(channel->Send(Encode(start), Channel::kNoDeadline));
  Sender<LeafT> sender(start.fill, channel);
  FOVEA_RETURN_IF_ERROR(TreeWalk<TreeT>::Run(grid.tree(), clip, &sender));
  const CoordBBox active = grid.evalActiveVoxelBoundingBox();
  return channel->Send(Encode(FieldEnd{active.empty() ? Box3{} : ToBox(active), sender.rounded()}),
                       Channel::kNoDeadline);
}

}  // namespace

Box3 ToBox(const CoordBBox& box) {
  return {{box.min().x(), box.min().y(), box.min().z()},
          {int64_t{box.max().x()} + 1, int64_t{box.max().y()} + 1, int64_t{box.max().z()} + 1}};
}

bool IsScalar(const openvdb::GridBase& grid) {
  return grid.isType<openvdb::FloatGrid>() || grid.isType<openvdb::DoubleGrid>() ||
         grid.isType<openvdb::Int32Grid>() || grid.isType<openvdb::Int64Grid>() ||
         grid.isType<openvdb::BoolGrid>() || grid.isType<openvdb::MaskGrid>();
}

namespace {

using ScalarGrids = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                      openvdb::Int64Grid, openvdb::BoolGrid, openvdb::MaskGrid>;

}  // namespace

void FreeVoxels(openvdb::GridBase* grid) {
  grid->apply<ScalarGrids>([](auto& typed) {
    constexpr int64_t kAtOnce = 1024;
    std::vector<typename std::decay_t<decltype(typed)>::TreeType::LeafNodeType*> leaves;
    typed.tree().stealNodes(leaves);
    ParallelFor(0, std::ssize(leaves), kAtOnce, 0, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) {
        delete leaves[static_cast<size_t>(i)];
      }
    });
  });
}

Status SendGrid(const openvdb::GridBase& grid, uint32_t index, const Box3& extent,
                Channel* channel) {
  Status status = InvalidArgument("type {} is not a scalar", grid.valueType());
  grid.apply<ScalarGrids>(
      [&](const auto& typed) { status = SendAs(typed, index, extent, channel); });
  return status;
}

}  // namespace fovea::ingest
