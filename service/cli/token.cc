#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "service/access/token_file.h"
#include "service/cli/checks.h"
#include "service/cli/console.h"
#include "service/cli/flags.h"
#include "service/cli/verbs.h"

namespace fovea::cli {

CLI::App* AddToken(CLI::App* app, TokenCommand* command) {
  CLI::App* verb = AddVerb(
      app, "token", "A new token for a server that asks for tokens",
      "  fovea token lab --tokens tokens.json --prefix lab/scans > lab.token\n"
      "  fovea token robot --tokens tokens.json --rights write --streams 2\n"
      "  fovea serve ROOT --tokens tokens.json\n"
      "  fovea info --server HOST:PORT --token-file lab.token\n"
      "The token is on stdout, this once. The file holds its SHA-256, and what it is good for.");
  verb->add_option("name", command->token.name, "What the log and errors call it")->required();
  verb->add_option("--tokens", command->file, "The file to add it to; made if it is not there")
      ->required()
      ->type_name("FILE");
  verb->add_option("--prefix", command->token.prefix,
                   "A folder of datasets, or one dataset (default: all)");
  verb->add_option("--rights", command->rights, "read, or write, which includes read")
      ->check(CLI::IsMember({"read", "write"}))
      ->capture_default_str();
  access::Quotas& quotas = command->token.quotas;
  verb->add_option("--streams", quotas.streams, "Streams at once (default: no limit)")
      ->check(Whole(1, 1'000'000));
  verb->add_option("--pixels-per-second", quotas.pixels_per_second,
                   "Pixels rendered, over time (default: no limit)")
      ->check(Positive());
  verb->add_option("--bytes-in-per-second", quotas.bytes_in_per_second,
                   "Bytes of requests and uploads, over time (default: no limit)")
      ->check(Positive());
  AddOutputFlags(verb, &command->output);
  return verb;
}

Status Check(TokenCommand* command) {
  command->token.right = command->rights == "write" ? access::Right::kWrite : access::Right::kRead;
  Status status = access::CheckToken(command->token);
  constexpr std::string_view kPrefix = "'prefix'";
  if (MessageOf(status).starts_with(kPrefix)) {
    status = InvalidArgument("--prefix{}", MessageOf(status).substr(kPrefix.size()));
  }
  return status;
}

Status Run(const TokenCommand& command) {
  auto tokens = access::ReadTokenFile(command.file);
  if (absl::IsNotFound(tokens.status())) {
    tokens = std::vector<access::Token>();
  }
  FOVEA_RETURN_IF_ERROR(tokens.status());
  for (const access::Token& token : *tokens) {
    if (token.name == command.token.name) {
      return AlreadyExists(
          "'{}' is in {} already; take its entry out first, or choose another name", token.name,
          command.file);
    }
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string secret, access::MakeToken());
  access::Token token = command.token;
  token.digest = access::DigestOf(secret);
  tokens->push_back(token);
  FOVEA_RETURN_IF_ERROR(access::WriteTokenFile(command.file, *tokens));
  if (command.output.json) {
    PrintJson(nlohmann::json({{"name", token.name}, {"token", secret}}));
  } else {
    PrintLine(secret);
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
