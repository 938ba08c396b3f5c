#include "service/frames/foveated_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/render/renderer.h"
#include "service/frames/deflate.h"
#include "service/frames/leaf_planes.h"

namespace fovea::frames {
namespace {

constexpr int64_t kFarthest = int64_t{1} << 20;  // pixels: edges of rectangles

using render::FaceFrame;
using render::FoveatedFrame;
using render::FrameLevel;
using render::PerspectiveFrame;
using render::PixelKind;
using render::Rect;

constexpr uint8_t kVersion = 1;
constexpr size_t kCrcBytes = 4;
constexpr int64_t kMostPixels = int64_t{1} << 25;
/// Pixels that a frame of any size may have, and those for each byte of its stream.
constexpr int64_t kFreePixels = int64_t{1} << 22;
constexpr int64_t kPixelsPerByte = 4096;

/// Whether so many pixels may come in a stream of so many bytes: what few bytes can make others
/// allocate.
bool IsAllowed(int64_t pixels, size_t stream_bytes) {
  return pixels <= kMostPixels &&
         pixels <= std::max(kFreePixels, kPixelsPerByte * static_cast<int64_t>(stream_bytes));
}

static_assert(std::endian::native == std::endian::little);

class Writer {
 public:
  template <typename T>
  void Put(std::type_identity_t<T> value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }
  void PutZeros(size_t count) { bytes_.append(count, '\0'); }
  void PutVector(const Vec3& v) {
    Put<double>(v.x);
    Put<double>(v.y);
    Put<double>(v.z);
  }
  void PutRect(const Rect& rect) {
    for (const int64_t edge : {rect.u0, rect.u1, rect.v0, rect.v1}) {
      Put<int32_t>(static_cast<int32_t>(edge));
    }
  }
  [[nodiscard]] std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
};

/// Reads past the end are zeros, which `failed` tells.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  T Get() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    if (bytes_.size() < sizeof(T)) {
      failed_ = true;
      bytes_ = {};
      return value;
    }
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_.remove_prefix(sizeof(T));
    return value;
  }
  /// Padding.
  void GetZeros(size_t count) {
    for (size_t i = 0; i < count; ++i) {
      failed_ = Get<uint8_t>() != 0 || failed_;
    }
  }
  /// A number from `low` to `high`.
  template <typename T>
  T GetWithin(T low, T high) {
    const T value = Get<T>();
    if (!(value >= low && value <= high)) {  // NaN fails too
      failed_ = true;
      return low;
    }
    return value;
  }
  Vec3 GetVector() {
    const double x = Get<double>();
    const double y = Get<double>();
    return {x, y, Get<double>()};
  }
  Rect GetRect() {
    constexpr auto kMost = static_cast<int32_t>(kFarthest);
    std::array<int64_t, 4> edges{};
    for (int64_t& edge : edges) {
      edge = GetWithin<int32_t>(-kMost, kMost);
    }
    return {edges[0], edges[1], edges[2], edges[3]};
  }
  [[nodiscard]] bool failed() const { return failed_; }
  [[nodiscard]] std::string_view rest() const { return bytes_; }

 private:
  std::string_view bytes_;
  bool failed_ = false;
};

// Header and geometry.

struct Header {
  bool perspective = false;
  int bits = render::kLeafBits;
  int images = 1;
  int width_px = 0, height_px = 0;
};

void WriteHeader(const FoveatedPicture& picture, int bits, Writer* to) {
  const auto* perspective = std::get_if<PerspectiveFrame>(&picture.frame);
  to->bytes().append(kFoveatedMagic);
  to->Put<uint8_t>(kVersion);
  to->Put<uint8_t>(perspective != nullptr ? 1 : 0);
  to->Put<uint8_t>(static_cast<uint8_t>(picture.smoothing));
  to->Put<uint8_t>(static_cast<uint8_t>(picture.basis));
  to->Put<uint8_t>(static_cast<uint8_t>(bits));
  to->Put<uint8_t>(static_cast<uint8_t>(perspective != nullptr ? perspective->faces.size() : 1));
  to->Put<uint8_t>(picture.marker ? 1 : 0);
  to->PutZeros(1);
  to->Put<uint32_t>(static_cast<uint32_t>(picture.width_px()));
  to->Put<uint32_t>(static_cast<uint32_t>(picture.height_px()));
  to->Put<float>(picture.background.red);
  to->Put<float>(picture.background.green);
  to->Put<float>(picture.background.blue);
  for (const double at : picture.marker.value_or(Marker{})) {
    to->Put<double>(at);
  }
}

/// What follows the version.
Header ReadHeader(Reader* from, FoveatedPicture* picture) {
  constexpr auto kMostSide = static_cast<uint32_t>(render::kMaxPicturePixels);
  Header header;
  header.perspective = from->GetWithin<uint8_t>(0, 1) != 0;
  picture->smoothing = static_cast<render::Smoothing>(from->GetWithin<uint8_t>(0, 2));
  picture->basis = static_cast<render::Basis>(from->GetWithin<uint8_t>(0, 1));
  header.bits = from->GetWithin<uint8_t>(render::kLeastLeafBits, render::kMostLeafBits);
  header.images =
      header.perspective ? from->GetWithin<uint8_t>(0, 6) : from->GetWithin<uint8_t>(1, 1);
  const bool marked = from->GetWithin<uint8_t>(0, 1) != 0;
  from->GetZeros(1);
  header.width_px = static_cast<int>(from->GetWithin<uint32_t>(1, kMostSide));
  header.height_px = static_cast<int>(from->GetWithin<uint32_t>(1, kMostSide));
  picture->background.red = from->GetWithin<float>(0, 1);
  picture->background.green = from->GetWithin<float>(0, 1);
  picture->background.blue = from->GetWithin<float>(0, 1);
  constexpr double kAnywhere = 1e300;  // a fovea may lie far beside the picture
  const double most = marked ? kAnywhere : 0;
  const double column = from->GetWithin<double>(-most, most);
  const double row = from->GetWithin<double>(-most, most);
  if (marked) {
    picture->marker = {column, row};
  }
  return header;
}

// Images: shapes of levels, and of faces.

constexpr int kMostWidthLog2 = 20;

/// Of a face seen at a grazing angle the crossing may be empty and far away; which pixels it
/// contains stays.
Rect HeldToRange(const Rect& rect) {
  const auto held = [](int64_t edge) { return std::clamp(edge, -kFarthest, kFarthest); };
  return {held(rect.u0), held(rect.u1), held(rect.v0), held(rect.v1)};
}

void WriteShape(const std::vector<FrameLevel>& levels, const Rect& sheet, Writer* to) {
  to->PutRect(sheet);
  to->Put<uint8_t>(static_cast<uint8_t>(levels.size()));
  to->Put<uint8_t>(
      static_cast<uint8_t>(std::countr_zero(static_cast<uint64_t>(levels.front().width))));
  to->PutZeros(6);
  for (const FrameLevel& level : levels) {
    to->PutRect(level.rect);
    to->PutRect(HeldToRange(level.crossing));
    to->Put<uint8_t>(static_cast<uint8_t>((level.void_u0 ? 1 : 0) | (level.void_u1 ? 2 : 0) |
                                          (level.void_v0 ? 4 : 0) | (level.void_v1 ? 8 : 0)));
    to->PutZeros(3);
  }
}

/// Levels without pixels yet. Adds the pixels they will have.
std::vector<FrameLevel> ReadShape(Reader* from, Rect* sheet, int64_t* pixels) {
  *sheet = from->GetRect();
  const int count = from->GetWithin<uint8_t>(1, render::kMostFrameLevels);
  const int width_log2 = from->GetWithin<uint8_t>(static_cast<uint8_t>(count - 1), kMostWidthLog2);
  from->GetZeros(6);
  std::vector<FrameLevel> levels(static_cast<size_t>(count));
  for (size_t l = 0; l < levels.size(); ++l) {
    FrameLevel& level = levels[l];
    level.width = int64_t{1} << (width_log2 - static_cast<int>(l));
    level.rect = from->GetRect();
    level.crossing = from->GetRect();
    const int voids = from->GetWithin<uint8_t>(0, 15);
    level.void_u0 = (voids & 1) != 0;
    level.void_u1 = (voids & 2) != 0;
    level.void_v0 = (voids & 4) != 0;
    level.void_v1 = (voids & 8) != 0;
    from->GetZeros(3);
    *pixels += level.rect.IsEmpty() ? 0 : level.rect.Width() * level.rect.Height();
  }
  return levels;
}

void WriteFace(const FaceFrame& image, Writer* to) {
  const render::PerspectiveFace& face = image.face;
  to->Put<uint8_t>(static_cast<uint8_t>(2 * face.axis_k + (face.ascending ? 0 : 1)));
  to->PutZeros(7);
  to->Put<double>(face.reference_z);
  to->Put<double>(face.common_path);
  to->PutVector(face.world_u);
  to->PutVector(face.world_v);
  to->PutVector(face.world_k);
}

FaceFrame ReadFace(Reader* from, const Vec3& eye) {
  FaceFrame image;
  render::PerspectiveFace& face = image.face;
  const int index = from->GetWithin<uint8_t>(0, 5);
  face.axis_k = index / 2;
  face.axis_u = face.axis_k == 0 ? 1 : 0;
  face.axis_v = face.axis_k == 2 ? 1 : 2;
  face.ascending = index % 2 == 0;
  from->GetZeros(7);
  face.eye = eye;
  face.reference_z = from->Get<double>();
  face.common_path = from->Get<double>();
  face.world_u = from->GetVector();
  face.world_v = from->GetVector();
  face.world_k = from->GetVector();
  return image;
}

void WriteFrame(const FoveatedFrame& frame, Writer* to) {
  for (const double m : frame.warp) {
    to->Put<double>(m);
  }
  WriteShape(frame.levels, frame.sheet, to);
}

void WriteFrame(const PerspectiveFrame& frame, Writer* to) {
  for (const Vec3& v : {frame.pinhole.eye, frame.pinhole.first, frame.pinhole.column_step,
                        frame.pinhole.row_step}) {
    to->PutVector(v);
  }
  for (const FaceFrame& image : frame.faces) {
    WriteFace(image, to);
    WriteShape(image.levels, image.sheet, to);
  }
}

FoveatedFrame ReadFlat(Reader* from, const Header& header, int64_t* pixels) {
  FoveatedFrame frame;
  frame.width_px = header.width_px;
  frame.height_px = header.height_px;
  for (double& m : frame.warp) {
    m = from->Get<double>();
  }
  frame.levels = ReadShape(from, &frame.sheet, pixels);
  return frame;
}

PerspectiveFrame ReadFaces(Reader* from, const Header& header, int64_t* pixels) {
  PerspectiveFrame frame;
  render::Pinhole& pinhole = frame.pinhole;
  pinhole.width_px = header.width_px;
  pinhole.height_px = header.height_px;
  for (Vec3* v : {&pinhole.eye, &pinhole.first, &pinhole.column_step, &pinhole.row_step}) {
    *v = from->GetVector();
  }
  for (int i = 0; i < header.images && !from->failed(); ++i) {
    frame.faces.push_back(ReadFace(from, pinhole.eye));
    frame.faces.back().levels = ReadShape(from, &frame.faces.back().sheet, pixels);
  }
  return frame;
}

/// The levels of each image, in a frame of either kind.
template <typename Frame>
auto ImagesOf(Frame& frame) {
  using Flat = std::conditional_t<std::is_const_v<Frame>, const FoveatedFrame, FoveatedFrame>;
  using Faces =
      std::conditional_t<std::is_const_v<Frame>, const PerspectiveFrame, PerspectiveFrame>;
  using Levels = std::conditional_t<std::is_const_v<Frame>, const std::vector<FrameLevel>,
                                    std::vector<FrameLevel>>;
  std::vector<Levels*> images;
  if (Flat* flat = std::get_if<FoveatedFrame>(&frame)) {
    images.push_back(&flat->levels);
  } else {
    Faces& faces = std::get<PerspectiveFrame>(frame);
    for (auto& face : faces.faces) {
      images.push_back(&face.levels);
    }
  }
  return images;
}

// Kinds.

/// A byte for each present pixel of all levels but the last.
std::string KindsOf(const std::vector<FrameLevel>& levels) {
  std::string kinds;
  for (size_t l = 0; l + 1 < levels.size(); ++l) {
    for (const PixelKind kind : levels[l].kinds) {
      if (kind != PixelKind::kAbsent) {
        kinds.push_back(kind == PixelKind::kSplit ? 1 : 0);
      }
    }
  }
  return kinds;
}

/// Marks the children of split pixels as leaves of `level`, whose kinds are all kAbsent, and counts
/// them. DATA_LOSS if one lies outside.
StatusOr<size_t> PlaceChildren(const FrameLevel& coarser, FrameLevel* level) {
  size_t present = 0;
  size_t at = 0;
  for (int64_t v = coarser.rect.v0; v < coarser.rect.v1; ++v) {
    for (int64_t u = coarser.rect.u0; u < coarser.rect.u1; ++u, ++at) {
      if (coarser.kinds[at] != PixelKind::kSplit) {
        continue;
      }
      if (!level->rect.Contains(2 * u, 2 * v) || !level->rect.Contains(2 * u + 1, 2 * v + 1)) {
        return DataLoss("a split pixel has children outside the next level");
      }
      PixelKind* first = &level->kinds[level->Index(2 * u, 2 * v)];
      PixelKind* below = first + level->rect.Width();
      first[0] = first[1] = below[0] = below[1] = PixelKind::kLeaf;
      present += 4;
    }
  }
  return present;
}

/// Gives the levels their pixels, kinds first; values are zeros.
Status ReadKinds(Inflater* from, std::vector<FrameLevel>* levels) {
  std::vector<uint8_t> split;
  for (size_t l = 0; l < levels->size(); ++l) {
    FrameLevel& level = (*levels)[l];
    if (level.rect.IsEmpty()) {
      return DataLoss("level {} has no pixels", l);
    }
    const auto pixels = static_cast<size_t>(level.rect.Width() * level.rect.Height());
    level.values.resize(pixels);
    level.kinds.assign(pixels, l == 0 ? PixelKind::kLeaf : PixelKind::kAbsent);
    size_t present = pixels;
    if (l > 0) {
      FOVEA_ASSIGN_OR_RETURN(present, PlaceChildren((*levels)[l - 1], &level));
    }
    if (l + 1 == levels->size()) {
      break;
    }
    split.resize(present);
    FOVEA_RETURN_IF_ERROR(from->Read(split));
    auto next = split.begin();
    for (PixelKind& kind : level.kinds) {
      if (kind == PixelKind::kAbsent) {
        continue;
      }
      if (*next > 1) {
        return DataLoss("level {} has a pixel of kind {}", l, *next);
      }
      kind = *next++ != 0 ? PixelKind::kSplit : PixelKind::kLeaf;
    }
  }
  return absl::OkStatus();
}

Status ReadPixels(std::string_view stream, int bits, FoveatedPicture* picture) {
  FOVEA_ASSIGN_OR_RETURN(Inflater inflater, Inflater::Make(stream));
  LevelsOfFrame shapes;
  std::vector<FrameLevel*> levels;
  for (std::vector<FrameLevel>* image : ImagesOf(picture->frame)) {
    FOVEA_RETURN_IF_ERROR(ReadKinds(&inflater, image));
    for (FrameLevel& level : *image) {
      shapes.push_back(&level);
      levels.push_back(&level);
    }
  }
  const size_t bytes = kLeafPlanes * CountLeaves(shapes);
  if (bytes / kMostInflation > stream.size()) {
    return DataLoss("its zlib stream is too short for {} leaves", bytes / kLeafPlanes);
  }
  std::vector<uint8_t> planes(bytes);
  FOVEA_RETURN_IF_ERROR(inflater.Read(planes));
  FOVEA_RETURN_IF_ERROR(inflater.Finish());
  return ReadLeafPlanes(planes, bits, levels);
}

Status Validate(const FoveatedPicture& picture) {
  return std::visit([](const auto& frame) { return render::Validate(frame); }, picture.frame);
}

StatusOr<FoveatedPicture> Decode(std::string_view bytes) {
  Reader reader(bytes);
  FoveatedPicture picture;
  int64_t pixels = 0;
  for (const char letter : kFoveatedMagic) {
    if (reader.Get<char>() != letter) {
      return DataLoss("it does not begin like one");
    }
  }
  if (const int version = reader.Get<uint8_t>(); version != kVersion) {
    return DataLoss("version {} is not known here, {} is", version, kVersion);
  }
  if (bytes.size() < kCrcBytes || Reader(bytes.substr(bytes.size() - kCrcBytes)).Get<uint32_t>() !=
                                      Crc32(bytes.substr(0, bytes.size() - kCrcBytes))) {
    return DataLoss("its checksum does not hold: bytes were damaged or are missing");
  }
  const Header header = ReadHeader(&reader, &picture);
  if (header.perspective) {
    picture.frame = ReadFaces(&reader, header, &pixels);
  } else {
    picture.frame = ReadFlat(&reader, header, &pixels);
  }
  if (reader.failed() || reader.rest().size() < kCrcBytes) {
    return DataLoss("a value of its header is outside its range, or it ends too early");
  }
  const std::string_view stream = reader.rest().substr(0, reader.rest().size() - kCrcBytes);
  if (!IsAllowed(pixels, stream.size())) {
    return DataLoss("{} pixels in {} bytes are more than a frame may have", pixels, stream.size());
  }
  FOVEA_RETURN_IF_ERROR(ReadPixels(stream, header.bits, &picture));
  if (const Status status = Validate(picture); !status.ok()) {
    return DataLoss("{}", MessageOf(status));
  }
  return picture;
}

}  // namespace

StatusOr<std::string> EncodeFoveated(const FoveatedPicture& picture, int bits) {
  Writer writer;
  WriteHeader(picture, bits, &writer);
  std::visit([&writer](const auto& frame) { WriteFrame(frame, &writer); }, picture.frame);
  std::string raw;
  LevelsOfFrame levels;
  int64_t pixels = 0;
  for (const std::vector<FrameLevel>* image : ImagesOf(picture.frame)) {
    raw += KindsOf(*image);
    for (const FrameLevel& level : *image) {
      levels.push_back(&level);
      pixels += static_cast<int64_t>(level.kinds.size());
    }
  }
  const size_t kinds = raw.size();
  raw.resize(kinds + kLeafPlanes * CountLeaves(levels));
  const std::span<uint8_t> bytes(reinterpret_cast<uint8_t*>(raw.data()), raw.size());
  WriteLeafPlanes(levels, bits, bytes.subspan(kinds));
  std::string& out = writer.bytes();
  const size_t head = out.size();
  FOVEA_RETURN_IF_ERROR(AppendDeflated(bytes, &out));
  if (!IsAllowed(pixels, out.size() - head)) {
    return ResourceExhausted(
        "the pyramid has {} pixels, more than a FOVEATED frame may have ({}); ask for a lower rate "
        "or for another encoding",
        pixels, kMostPixels);
  }
  writer.Put<uint32_t>(Crc32(out));
  return std::move(out);
}

int64_t MostFoveatedBytes(int64_t pyramid_pixels) {
  constexpr int64_t kHeads = 8192;  // header, shapes of 6 x 16 levels, checksums
  const int64_t raw = (static_cast<int64_t>(kLeafPlanes) + 1) * pyramid_pixels;
  return kHeads + raw + raw / 1000;
}

StatusOr<FoveatedPicture> DecodeFoveated(std::string_view bytes) {
  StatusOr<FoveatedPicture> picture = Decode(bytes);
  return picture.ok() ? std::move(picture)
                      : StatusOr<FoveatedPicture>(
                            Annotate(picture.status(), "a FOVEATED frame cannot be read"));
}

}  // namespace fovea::frames
