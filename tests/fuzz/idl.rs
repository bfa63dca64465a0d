//! Texts of message definitions in IDL.

use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::dynamic::{FieldPlan, ReadAs, numeric_paths};
use tactile_pose_fusion::msg::type_hash;

use super::driver::{Answer, Target};
use super::msg_common::read_all_ways;
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "idl", seeds, mutate: other, run, min_understood: 0.2 };

const WORDS: [&str; 48] = [
    "module",
    "struct",
    "enum",
    "typedef",
    "const",
    "union",
    "sequence<",
    ">",
    "<",
    "<3>",
    "[3]",
    "[0]",
    "[4294967295]",
    "4294967296",
    "0x7",
    ",",
    ";",
    "{",
    "}",
    "};",
    "(",
    ")",
    "@",
    "@key",
    "@verbatim (language=\"comment\", text=",
    "\"",
    "'",
    "\\",
    "//",
    "/*",
    "*/",
    "#include",
    "::",
    "p::msg::T",
    "::p::msg::U",
    "U",
    "T",
    "long",
    "long long",
    "unsigned",
    "double",
    "string",
    "wstring",
    "octet",
    "boolean",
    "builtin_interfaces::msg::Time",
    "\n====\nIDL: p/msg/U\n",
    "\u{e9}",
];

fn seeds() -> Vec<Vec<u8>> {
    let doubling: Vec<String> = (0..24).map(|n| format!("struct D{n} {{ D{0} a; D{0} b; }};", n + 1)).collect();
    let texts = [
        "module p { module msg {\n  typedef double double__9[9];\n  const long N = 3;\n  @verbatim (language=\"comment\", text=\"x\" \"\\n\")\n  struct U { octet a; string<N> b; };\n  enum E { A, B };\n  struct T { p::msg::U u; sequence<p::msg::U, 2> us; double__9 c; wstring d; unsigned long long e, f[2][3]; E g; @default (value=TRUE) boolean h; };\n}; };\n".to_owned(),
        "========\nIDL: p/msg/T\n#include \"U.idl\"\nmodule p { module msg { struct T { sequence<p::msg::U> u; builtin_interfaces::msg::Time at; /* no\n */ float x; }; }; };\n========\nIDL: p/msg/U\nmodule p { module msg { struct U { uint8 structure_needs_at_least_one_member; }; }; };\n".to_owned(),
        format!("module p {{ module msg {{ struct T {{ D0 a; }}; {} struct D24 {{ int8 x; }}; }}; }};", doubling.concat()),
    ];
    texts.into_iter().map(String::into_bytes).collect()
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    mutate::text(random, seed, other, &WORDS)
}

fn run(input: &[u8]) -> Answer {
    let text = String::from_utf8_lossy(input);
    let tree = match TypeTree::from_encoded("p/msg/T", "ros2idl", &text) {
        Ok(tree) => tree,
        Err(error) => return super::one_line(&error),
    };
    let paths = numeric_paths(&tree);
    for field in paths.iter().step_by(1 + paths.len() / 128) {
        FieldPlan::compile(&tree, &field.path, ReadAs::Numbers).expect("a listed path compiles");
    }
    for cdr in [&[0, 1, 0, 0][..], &[0, 1, 0, 0, 3, 0, 0, 0, 1, 1, 1, 1, 1]] {
        let _ = read_all_ways(&tree, cdr);
    }
    type_hash(&tree);
    let kinds: Vec<_> = tree.root().fields.iter().map(|field| field.ty.to_string()).collect();
    Answer::understood(&(paths.len().min(32), kinds, tree.dependencies().count()))
}
