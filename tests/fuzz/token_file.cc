// The file of tokens: what is taken is written back the same.

#include "service/access/token_file.h"

#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto tokens = access::ParseTokens(text);
  if (!tokens.ok()) {
    return 0;
  }
  for (const access::Token& token : *tokens) {
    fuzz::Require(access::CheckToken(token).ok());
  }
  const auto again = access::ParseTokens(access::FormatTokens(*tokens));
  fuzz::Require(again.ok() && *again == *tokens);
  return 0;
}
