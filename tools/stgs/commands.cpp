// SPDX-License-Identifier: Apache-2.0
#include "command.h"

namespace stgs::tools {

std::vector<std::unique_ptr<Command>> all_commands() {
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(make_prepare());
  commands.push_back(make_train());
  commands.push_back(make_pack());
  commands.push_back(make_encode());
  commands.push_back(make_live());
  commands.push_back(make_finalize());
  commands.push_back(make_info());
  commands.push_back(make_validate());
  commands.push_back(make_render());
  commands.push_back(make_play());
  commands.push_back(make_serve());
  commands.push_back(make_web());
  commands.push_back(make_bench());
  commands.push_back(make_evaluate());
  commands.push_back(make_compare());
  commands.push_back(make_convert());
  commands.push_back(make_help());
  commands.push_back(make_version());
  return commands;
}

}  // namespace stgs::tools
