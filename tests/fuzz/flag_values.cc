// Values of flags, and whole command lines.

#include <string>
#include <vector>

#include "service/cli/commands.h"
#include "service/cli/values.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea::cli;

void ParseAll(const std::string& text) {
  (void)ParseNumber(text).ok();
  if (const auto position = ParsePosition(text); position.ok()) {
    fovea::fuzz::Require(ParsePosition(FormatPosition(*position)).ok());
  }
  (void)ParseTimeList(text).ok();
  (void)ParseRate(text).ok();
  (void)ParseWindow(text).ok();
  (void)ParseVector(text).ok();
  (void)ParseView(text).ok();
  (void)ParseSize(text).ok();
  (void)ParseBox(text).ok();
  (void)ParseSteps(text).ok();
  (void)ParseShard(text).ok();
  (void)ParseWeighting(text).ok();
  (void)ParseReconstruction(text).ok();
  (void)ParseSmoothing(text).ok();
  (void)ParseBasis(text).ok();
  (void)ParseColor(text).ok();
  (void)ParseTransfer(text[0] == '@' ? text.substr(1) : text).ok();  // no files
  (void)ParseCompositing(text).ok();
  (void)ParseLighting(text).ok();
  (void)ParseDirection(text).ok();
  (void)ParseClipBox(text).ok();
  (void)ParseClipPlane(text).ok();
  (void)ParseMode(text).ok();
  (void)ShellQuote(text);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fovea::fuzz::Input input(data, size);
  const bool whole_line = input.Number<uint8_t>() % 8 == 0;
  if (!whole_line) {
    const std::string text = input.Rest();
    ParseAll(text);
    return 0;
  }
  std::vector<std::string> arguments;
  while (!input.empty() && arguments.size() < 64) {
    arguments.push_back(input.Until('\n'));
  }
  const ParseResult result = ParseCommandLine(arguments);
  fovea::fuzz::Require(result.command.has_value() || !result.text.empty());
  return 0;
}
