#include "service/coefficients/block.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "engine/store/layout.h"
#include "service/frames/deflate.h"

namespace fovea::coefficients {
namespace {

constexpr std::string_view kMagic = "FVCB";
constexpr uint8_t kVersion = 1;
constexpr std::array<const char*, 3> kTypes = {"float32", "int16", "int32"};
constexpr size_t kHeaderBytes = 32;
constexpr size_t kBoxBytes = 32;
constexpr size_t kCrcBytes = 4;

template <typename T>
void Append(T value, std::string* to) {
  to->append(reinterpret_cast<const char*>(&value), sizeof(T));  // little-endian machines only
}

template <typename T>
T ReadAt(std::string_view bytes, size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

uint8_t TypeNumber(const std::string& type) {
  return type == kTypes[0] ? 0 : type == kTypes[1] ? 1 : 2;
}

uint32_t CrcOf(std::span<const std::byte> bytes) {
  return frames::Crc32({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

template <typename U>
U Zigzag(U value) {
  using S = std::make_signed_t<U>;
  return static_cast<U>(static_cast<U>(value << 1U) ^
                        static_cast<U>(static_cast<S>(value) >> std::numeric_limits<S>::digits));
}

template <typename U>
U UndoZigzag(U value) {
  return static_cast<U>(static_cast<U>(value >> 1U) ^ static_cast<U>(-(value & 1U)));
}

/// The one rule of both directions: how the numbers of a box become what is sent.
template <typename U>
class Coder {
 public:
  explicit Coder(const BlockHeader& header) : zigzag_plain_(store::IsIntegerType(header.type)) {}

  [[nodiscard]] U ToSent(U number, U base, bool difference) const {
    if (difference) {
      return Zigzag(static_cast<U>(number - base));
    }
    return zigzag_plain_ ? Zigzag(number) : number;
  }
  [[nodiscard]] U FromSent(U sent, U base, bool difference) const {
    if (difference) {
      return static_cast<U>(UndoZigzag(sent) + base);
    }
    return zigzag_plain_ ? UndoZigzag(sent) : sent;
  }

 private:
  const bool zigzag_plain_;
};

template <typename U>
U NumberAt(std::span<const std::byte> numbers, size_t index) {
  U value;
  std::memcpy(&value, numbers.data() + index * sizeof(U), sizeof(U));
  return value;
}

/// The mask, then plane by plane the bytes of what is not 0.
template <typename U>
std::vector<uint8_t> MaskAndPlanes(const BlockHeader& header, std::span<const std::byte> numbers,
                                   std::span<const std::byte> base) {
  const Coder<U> coder(header);
  const auto values = static_cast<size_t>(header.Values());
  std::vector<uint8_t> bytes((values + 7) / 8);
  std::vector<U> sent;
  sent.reserve(values);
  size_t i = 0;
  for (const BlockBox& box : header.boxes) {
    for (const size_t end = i + static_cast<size_t>(box.Values()); i < end; ++i) {
      const U from = box.difference ? NumberAt<U>(base, i) : U{0};
      const U one = coder.ToSent(NumberAt<U>(numbers, i), from, box.difference);
      if (one != 0) {
        bytes[i / 8] = static_cast<uint8_t>(bytes[i / 8] | (1U << (i % 8)));
        sent.push_back(one);
      }
    }
  }
  bytes.reserve(bytes.size() + sent.size() * sizeof(U));
  for (size_t plane = 0; plane < sizeof(U); ++plane) {
    for (const U one : sent) {
      bytes.push_back(static_cast<uint8_t>(one >> (8 * plane)));
    }
  }
  return bytes;
}

/// The numbers again, from what MaskAndPlanes made.
template <typename U>
StatusOr<std::vector<std::byte>> FromMaskAndPlanes(const BlockHeader& header,
                                                   frames::Inflater* inflater,
                                                   std::span<const std::byte> base) {
  const auto values = static_cast<size_t>(header.Values());
  std::vector<uint8_t> mask((values + 7) / 8);
  FOVEA_RETURN_IF_ERROR(inflater->Read(mask));
  size_t count = 0;
  for (const uint8_t bits : mask) {
    count += static_cast<size_t>(__builtin_popcount(bits));
  }
  if (values % 8 != 0 && mask.back() >> (values % 8) != 0) {
    return DataLoss("its mask has bits beyond its {} numbers", values);
  }
  std::vector<uint8_t> planes(count * sizeof(U));
  FOVEA_RETURN_IF_ERROR(inflater->Read(planes));
  FOVEA_RETURN_IF_ERROR(inflater->Finish());

  const Coder<U> coder(header);
  std::vector<std::byte> numbers(values * sizeof(U));
  size_t i = 0;
  size_t next = 0;
  for (const BlockBox& box : header.boxes) {
    for (const size_t end = i + static_cast<size_t>(box.Values()); i < end; ++i) {
      U sent = 0;
      if ((mask[i / 8] >> (i % 8) & 1U) != 0) {
        for (size_t plane = 0; plane < sizeof(U); ++plane) {
          sent = static_cast<U>(sent | static_cast<U>(planes[plane * count + next]) << (8 * plane));
        }
        ++next;
      }
      const U from = box.difference ? NumberAt<U>(base, i) : U{0};
      const U number = coder.FromSent(sent, from, box.difference);
      std::memcpy(numbers.data() + i * sizeof(U), &number, sizeof(U));
    }
  }
  return numbers;
}

/// Whether these can be coefficients.
Status CheckNumbers(const std::string& type, std::span<const std::byte> numbers) {
  std::vector<float> values(numbers.size() / static_cast<size_t>(store::BytesOfType(type)));
  store::FromStored(numbers, {type, 1}, values);
  const float largest = store::LargestMagnitude(values);
  if (!std::isfinite(largest)) {
    return DataLoss("one of its numbers is not finite");
  }
  if (type == kTypes[2] && largest > static_cast<float>(store::MostOfType(type))) {
    return DataLoss("one of its numbers is {}, more than {} holds", largest, type);
  }
  return absl::OkStatus();
}

void AppendBox(const BlockBox& box, const Hierarchy& hierarchy, std::string* to) {
  Append(static_cast<uint8_t>(box.level == kCoarse ? 0 : hierarchy.finest() - box.level), to);
  Append(static_cast<uint8_t>(box.difference ? 1 : 0), to);
  Append(uint16_t{0}, to);
  Append(box.scale, to);
  for (int axis = 0; axis < 3; ++axis) {
    Append(static_cast<uint32_t>(box.box.lo[axis]), to);
  }
  for (int axis = 0; axis < 3; ++axis) {
    Append(static_cast<uint32_t>(box.box.Size()[axis]), to);
  }
}

StatusOr<BlockBox> ParseBox(std::string_view bytes, const std::string& type,
                            const Hierarchy& hierarchy) {
  BlockBox box;
  const int log2_width = ReadAt<uint8_t>(bytes, 0);
  const auto flags = ReadAt<uint8_t>(bytes, 1);
  if (log2_width > hierarchy.finest() || flags > 1 || ReadAt<uint16_t>(bytes, 2) != 0) {
    return DataLoss("detail of super-voxels 2^{} voxels wide, with flags {}, is not there",
                    log2_width, flags);
  }
  box.level = log2_width == 0 ? kCoarse : hierarchy.finest() - log2_width;
  box.difference = flags == 1;
  box.scale = ReadAt<float>(bytes, 4);
  if (!std::isfinite(box.scale) || !(box.scale > 0) || (type == kTypes[0] && box.scale != 1)) {
    return DataLoss("a scale of {} for {}", box.scale, type);
  }
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<size_t>(4 * axis);
    box.box.lo[axis] = ReadAt<uint32_t>(bytes, 8 + at);
    box.box.hi[axis] = box.box.lo[axis] + ReadAt<uint32_t>(bytes, 20 + at);
  }
  const Int3 dims = hierarchy.DimsAt(box.level == kCoarse ? 0 : box.level);
  if (box.box.IsEmpty() || !Box3::OfSize(dims).Contains(box.box)) {
    return DataLoss("a box that is empty, or not within its level of {} x {} x {}", dims.x, dims.y,
                    dims.z);
  }
  return box;
}

bool Overlap(const std::vector<BlockBox>& boxes) {
  for (size_t i = 0; i < boxes.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (boxes[i].level == boxes[j].level && !Intersect(boxes[i].box, boxes[j].box).IsEmpty()) {
        return true;
      }
    }
  }
  return false;
}

Status CheckLimits(const BlockHeader& header) {
  if (header.boxes.empty() || header.boxes.size() > kMaxBoxes || header.field < 0 ||
      header.field >= static_cast<int>(kMaxFields)) {
    return DataLoss("{} boxes of field {}", header.boxes.size(), header.field);
  }
  int64_t left = kMaxNumberBytes / store::BytesOfType(header.type);
  for (const BlockBox& box : header.boxes) {
    // A box of a level has at most 2^48 places: no product of these overflows.
    left -= box.Values();
    if (left < 0) {
      return DataLoss("more than {} bytes of numbers", kMaxNumberBytes);
    }
  }
  if (header.HasDifferences() == (header.base_step == header.step)) {
    return DataLoss("base step {} at step {} does not go with its boxes", header.base_step,
                    header.step);
  }
  return Overlap(header.boxes) ? DataLoss("its boxes overlap") : absl::OkStatus();
}

}  // namespace

int64_t BlockBox::Values() const {
  return (level == kCoarse ? 1 : store::kSubBands) * box.Volume();
}

int64_t BlockHeader::Values() const {
  int64_t values = 0;
  for (const BlockBox& box : boxes) {
    values += box.Values();
  }
  return values;
}

bool BlockHeader::HasDifferences() const {
  for (const BlockBox& box : boxes) {
    if (box.difference) {
      return true;
    }
  }
  return false;
}

StatusOr<std::string> EncodeBlock(const BlockHeader& header, const Hierarchy& hierarchy,
                                  std::span<const std::byte> numbers,
                                  std::span<const std::byte> base) {
  if (const Status status = CheckLimits(header); !status.ok()) {
    return Internal("a block that cannot be sent: {}", MessageOf(status));
  }
  std::string bytes(kMagic);
  Append(kVersion, &bytes);
  Append(TypeNumber(header.type), &bytes);
  Append(static_cast<uint8_t>(header.field), &bytes);
  Append(uint8_t{0}, &bytes);
  Append(header.step, &bytes);
  Append(header.base_step, &bytes);
  Append(static_cast<uint32_t>(header.boxes.size()), &bytes);
  Append(CrcOf(numbers), &bytes);
  for (const BlockBox& box : header.boxes) {
    AppendBox(box, hierarchy, &bytes);
  }
  const auto sent = store::BytesOfType(header.type) == 2
                        ? MaskAndPlanes<uint16_t>(header, numbers, base)
                        : MaskAndPlanes<uint32_t>(header, numbers, base);
  FOVEA_RETURN_IF_ERROR(frames::AppendDeflated(sent, &bytes));
  Append(frames::Crc32(bytes), &bytes);
  return bytes;
}

StatusOr<ReceivedBlock> ParseBlock(std::string_view bytes, const Hierarchy& hierarchy) {
  if (bytes.size() < kHeaderBytes + kCrcBytes || bytes.size() > kMaxBlockBytes ||
      !bytes.starts_with(kMagic)) {
    return DataLoss("{} bytes that are no block of coefficients", bytes.size());
  }
  if (bytes[4] != kVersion) {
    return DataLoss("a block of version {}; this program reads {}",
                    static_cast<unsigned char>(bytes[4]), kVersion);
  }
  const size_t end = bytes.size() - kCrcBytes;
  if (frames::Crc32(bytes.substr(0, end)) != ReadAt<uint32_t>(bytes, end)) {
    return DataLoss("a block whose checksum does not hold");
  }
  const auto type = ReadAt<uint8_t>(bytes, 5);
  const auto boxes = ReadAt<uint32_t>(bytes, 24);
  if (type >= kTypes.size() || bytes[7] != 0 || boxes > kMaxBoxes ||
      kHeaderBytes + boxes * kBoxBytes > end) {
    return DataLoss("a block of type {} with {} boxes in {} bytes", type, boxes, bytes.size());
  }
  ReceivedBlock block;
  BlockHeader& header = block.header;
  header.type = kTypes[type];
  header.field = ReadAt<uint8_t>(bytes, 6);
  header.step = ReadAt<uint64_t>(bytes, 8);
  header.base_step = ReadAt<uint64_t>(bytes, 16);
  block.numbers_crc = ReadAt<uint32_t>(bytes, 28);
  for (uint32_t i = 0; i < boxes; ++i) {
    FOVEA_ASSIGN_OR_RETURN(
        header.boxes.emplace_back(),
        ParseBox(bytes.substr(kHeaderBytes + i * kBoxBytes, kBoxBytes), header.type, hierarchy));
  }
  FOVEA_RETURN_IF_ERROR(CheckLimits(header));
  const size_t begin = kHeaderBytes + boxes * kBoxBytes;
  block.stream = bytes.substr(begin, end - begin);
  return block;
}

StatusOr<std::vector<std::byte>> DecodeNumbers(const ReceivedBlock& block,
                                               std::span<const std::byte> base) {
  const BlockHeader& header = block.header;
  const int64_t bytes = header.Values() * store::BytesOfType(header.type);
  if (header.HasDifferences() && static_cast<int64_t>(base.size()) != bytes) {
    return Internal("differences of {} bytes from a base of {}", bytes, base.size());
  }
  FOVEA_ASSIGN_OR_RETURN(frames::Inflater inflater, frames::Inflater::Make(block.stream));
  const bool is_short = store::BytesOfType(header.type) == 2;
  auto numbers = is_short ? FromMaskAndPlanes<uint16_t>(header, &inflater, base)
                          : FromMaskAndPlanes<uint32_t>(header, &inflater, base);
  FOVEA_RETURN_IF_ERROR(numbers.status());
  if (CrcOf(*numbers) != block.numbers_crc) {
    return header.HasDifferences()
               ? FailedPrecondition("differences from step {} that do not fit what is held of it",
                                    header.base_step)
               : DataLoss("the checksum of its numbers does not hold");
  }
  FOVEA_RETURN_IF_ERROR(CheckNumbers(header.type, *numbers));
  return numbers;
}

}  // namespace fovea::coefficients
