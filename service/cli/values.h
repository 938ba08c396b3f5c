#ifndef SERVICE_CLI_VALUES_H_
#define SERVICE_CLI_VALUES_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "engine/base/status.h"
#include "engine/store/retention.h"
#include "engine/volume/geometry.h"
#include "service/frames/spec.h"

/// The texts that flags take, and what they mean. Every parser returns INVALID_ARGUMENT that
/// repeats the text and shows the form; ranges are checked by frames::ValidateSpec afterwards.
namespace fovea::cli {

/// "0,0.5,2" or the name of a file: seconds, with commas, blanks or line ends between them.
/// NOT_FOUND if the file cannot be read.
[[nodiscard]] StatusOr<std::vector<double>> ParseTimes(const std::string& text);
/// What is in such a file; may be none.
[[nodiscard]] StatusOr<std::vector<double>> ParseTimeList(std::string_view list);

/// 'A', 'A-B', 'A-BxS' or 'A-': steps from A to B, B included, every S-th.
struct StepRange {
  int64_t first = 0;
  std::optional<int64_t> last;  // absent: the last there is
  int64_t stride = 1;
  friend bool operator==(const StepRange&, const StepRange&) = default;
};

/// Part `index` of `count`: 'i/n', i from 0.
struct Shard {
  int64_t index = 0, count = 1;
  friend bool operator==(const Shard&, const Shard&) = default;
};

[[nodiscard]] StatusOr<double> ParseNumber(std::string_view text);
/// 'X,Y,Z' in voxels, 'X,Y,Zw' in world units.
[[nodiscard]] StatusOr<frames::Position> ParsePosition(std::string_view text);
/// 'R', or 'RX,RY,RZ'.
[[nodiscard]] StatusOr<Rate> ParseRate(std::string_view text);
/// 'X,Y,Z:RATE' or 'X,Y,Zw:RATE': a window to retain.
[[nodiscard]] StatusOr<store::AskedWindow> ParseRetained(std::string_view text);
[[nodiscard]] std::string FormatRetained(const store::RetainedWindow& window);
/// 'cube', 'sphere' or 'smooth'.
[[nodiscard]] StatusOr<WindowShape> ParseWindow(std::string_view text);
/// 'X,Y,Z', a direction.
[[nodiscard]] StatusOr<Vec3> ParseVector(std::string_view text);
/// 'AZ,EL' in degrees.
[[nodiscard]] StatusOr<std::pair<double, double>> ParseView(std::string_view text);
/// 'WxH' in pixels.
[[nodiscard]] StatusOr<std::pair<int64_t, int64_t>> ParseSize(std::string_view text);
/// 'X0,Y0,Z0,X1,Y1,Z1' in whole voxels; the upper corner is not included.
[[nodiscard]] StatusOr<Box3> ParseBox(std::string_view text);
[[nodiscard]] StatusOr<StepRange> ParseSteps(std::string_view text);
[[nodiscard]] StatusOr<Shard> ParseShard(std::string_view text);
/// 'none', 'chop' or 'falloff:A'.
[[nodiscard]] StatusOr<render::Weighting> ParseWeighting(std::string_view text);
/// 'none', 'image' or 'full'.
[[nodiscard]] StatusOr<Reconstruction> ParseReconstruction(std::string_view text);
[[nodiscard]] StatusOr<render::Smoothing> ParseSmoothing(std::string_view text);
/// 'bilinear' or 'bspline'.
[[nodiscard]] StatusOr<render::Basis> ParseBasis(std::string_view text);
/// 'R,G,B', linear, 0 to 1.
[[nodiscard]] StatusOr<render::Color> ParseColor(std::string_view text);
/// 'V:R,G,B:A;...', the same as JSON, or the name of a file that ends in .json: NOT_FOUND or
/// FAILED_PRECONDITION if that is what is wrong.
[[nodiscard]] StatusOr<render::TransferFunction> ParseTransfer(const std::string& text);

/// 'emission' or 'maximum'.
[[nodiscard]] StatusOr<render::Compositing> ParseCompositing(std::string_view text);
/// 'AMBIENT,DIFFUSE,SPECULAR[,SHININESS]'; '' for the defaults. Always enabled.
[[nodiscard]] StatusOr<render::Lighting> ParseLighting(std::string_view text);
/// 'X,Y,Z': a direction in the world.
[[nodiscard]] StatusOr<Vec3> ParseDirection(std::string_view text);
/// 'X0,Y0,Z0,X1,Y1,Z1' in voxels, with a trailing w in world units.
[[nodiscard]] StatusOr<frames::ClipBox> ParseClipBox(std::string_view text);
/// 'NX,NY,NZ,OFFSET' in voxels, with a trailing w in world units.
[[nodiscard]] StatusOr<frames::ClipPlane> ParseClipPlane(std::string_view text);
/// 'two-phase', 'fused' or 'auto'.
[[nodiscard]] StatusOr<frames::Mode> ParseMode(std::string_view text);

[[nodiscard]] std::string FormatPosition(const frames::Position& position);
[[nodiscard]] std::string FormatWeighting(const render::Weighting& weighting);
[[nodiscard]] const char* WindowName(WindowShape window);
[[nodiscard]] const char* ReconstructionName(Reconstruction how);
[[nodiscard]] const char* SmoothingName(render::Smoothing smoothing);
[[nodiscard]] const char* BasisName(render::Basis basis);

/// The text as one word of a POSIX shell.
[[nodiscard]] std::string ShellQuote(const std::string& text);

/// The part of PinningFlags that shades, cuts and colours, each flag with a space before it; empty
/// where nothing was asked for.
[[nodiscard]] std::string OptionFlags(const frames::FrameSpec& resolved);

/// The flags that ask for exactly this picture again. `resolved` has nothing left to default;
/// what every dataset would choose alike (black background, the middle as centre) is left out.
[[nodiscard]] std::string PinningFlags(const frames::FrameSpec& resolved, const Int3& dims);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_VALUES_H_
