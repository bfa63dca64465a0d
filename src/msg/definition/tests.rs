use super::*;

fn parsed(text: &str) -> MessageDefinition {
    MessageDefinition::parse("pkg/T", text).expect("it parses")
}

fn types(text: &str) -> Vec<String> {
    parsed(text).fields.iter().map(|field| format!("{} {}", field.ty, field.name)).collect()
}

fn refused(text: &str) -> String {
    MessageDefinition::parse("pkg/T", text).expect_err("it is refused").to_string()
}

fn tree_error(text: &str) -> String {
    TypeTree::from_schema("pkg/T", text).expect_err("it is refused").to_string()
}

#[test]
fn every_form_of_type_is_read() {
    let text = "bool a\nbyte b\nchar c\nfloat32[] d\nfloat64[3] e\nint8[<=4] f\nstring<=5 g\nstring<=5[<=6] h\nwstring \
                i\nwstring<=7[2] j\nOther k\nother_pkg/Other[] l\nother_pkg/msg/Other m\ntime n\nduration[] o\nuint64[ 2 \
                ] p\nother_pkg/srv/Do_Request q\r\n";
    assert_eq!(
        types(text),
        [
            "bool a",
            "byte b",
            "char c",
            "float32[] d",
            "float64[3] e",
            "int8[<=4] f",
            "string<=5 g",
            "string<=5[<=6] h",
            "wstring i",
            "wstring<=7[2] j",
            "pkg/msg/Other k",
            "other_pkg/msg/Other[] l",
            "other_pkg/msg/Other m",
            "builtin_interfaces/msg/Time n",
            "builtin_interfaces/msg/Duration[] o",
            "uint64[2] p",
            "other_pkg/srv/Do_Request q",
        ]
    );
}

#[test]
fn comments_defaults_and_constants_are_told_apart() {
    let text = "\u{feff}# top\n\n  float64 w 1.5 # one # two\nint32 X=-5#five\nstring S = \"a # b\" # c\nstring D 'it\\'s' # \
                d\nstring[] L ['#', \"]\"]  # e\nstring RAW=two words # f\nuint8 y# don't\n\tint32 z";
    let definition = parsed(text);
    let fields: Vec<_> =
        definition.fields.iter().map(|field| (field.name.as_str(), field.default.as_deref())).collect();
    assert_eq!(
        fields,
        [("w", Some("1.5")), ("D", Some("it's")), ("L", Some("['#', \"]\"]")), ("y", None), ("z", None)]
    );
    let constants: Vec<_> =
        definition.constants.iter().map(|constant| (constant.name.as_str(), constant.value.as_str())).collect();
    assert_eq!(constants, [("X", "-5"), ("S", "a # b"), ("RAW", "two words")]);
}

#[test]
fn lines_that_say_nothing_are_refused_with_their_number() {
    assert_eq!(refused("int32 a\nint32"), "definition of pkg/msg/T, line 2: expected a type and a name in 'int32'");
    for (text, reason) in [
        ("int32 a\nint32 a", "a second field 'a'"),
        ("int32 A=1\nint32 A=1", "a second constant 'A'"),
        ("int32 A=", "constant 'A' has no value"),
        ("int32[] A=1", "constant 'A' can't be an array"),
        ("Other A=1", "constant 'A' must be a primitive or a string"),
        ("int32[0] a", "an array or bound of 0"),
        ("int32[-1] a", "'-1' is not a count"),
        ("int32[99999999999] a", "is not a count"),
        ("int32[ a", "expected a type and a name"),
        ("int32[2 ]x a", "brackets left open"),
        ("int32<=3 a", "'int32' can't have a bound"),
        ("int32 a-b", "unexpected text after 'a'"),
        ("int32 9a", "'9a' is not a field name"),
        ("int32 -", "expected a field name"),
        ("a/b/c/d e", "'a/b/c/d' is not a type"),
        ("string S=\"open", "a string without its closing quote"),
        ("string S=\"a\" b", "unexpected text after the value"),
        ("string[] s ['a'", "a list without its closing bracket"),
        ("---", "expected a type and a name"),
    ] {
        assert!(refused(text).contains(reason), "{text}: {}", refused(text));
    }
    let name = MessageDefinition::parse("T", "").expect_err("no package").to_string();
    assert_eq!(name, "'T' is not a type name: expected package/msg/Name");
}

#[test]
fn old_and_new_type_names_are_the_same() {
    assert_eq!(canonical_type_name("sensor_msgs/JointState"), "sensor_msgs/msg/JointState");
    assert_eq!(canonical_type_name(" sensor_msgs/msg/JointState"), "sensor_msgs/msg/JointState");
    assert_eq!(canonical_type_name("pkg/srv/Do_Event"), "pkg/srv/Do_Event");
}

#[test]
fn concatenated_schemas_resolve_by_any_form_of_name() {
    let line = "=".repeat(80);
    let text = format!(
        "Header header\nInner[] inner\n{line}\nMSG: std_msgs/msg/Header\nbuiltin_interfaces/Time stamp\nstring \
         frame_id\n\n{line}\r\nMSG: pkg/Inner\r\nfloat32 x\n{line}\nMSG: pkg/Inner\nfloat32 x\n"
    );
    let tree = TypeTree::from_schema("pkg/T", &text).expect("it resolves");
    assert_eq!(tree.type_name(), "pkg/msg/T");
    assert_eq!(tree.root().field("header").map(|field| field.ty.to_string()).as_deref(), Some("std_msgs/msg/Header"));
    let names: Vec<&str> = tree.dependencies().map(|definition| definition.type_name.as_str()).collect();
    assert_eq!(names, ["builtin_interfaces/msg/Time", "pkg/msg/Inner", "std_msgs/msg/Header"]);
    // Some writers put a header before the first text, too.
    let headed = format!("{line}\nMSG: pkg/T\n{text}");
    assert_eq!(TypeTree::from_schema("pkg/T", &headed).expect("it resolves"), tree);
}

#[test]
fn missing_types_are_asked_for_and_then_named() {
    let mut asked = vec![];
    let tree = TypeTree::resolve("pkg/T", "Inner a\nother/Deep b\n", &mut |name| {
        asked.push(name.to_owned());
        (!name.starts_with("builtin")).then(|| "builtin_interfaces/Duration d\n".to_owned())
    });
    assert_eq!(tree.expect("it resolves").dependencies().count(), 3);
    assert_eq!(asked, ["pkg/msg/Inner", "builtin_interfaces/msg/Duration", "other/msg/Deep"]);
    assert_eq!(
        tree_error("other/Deep b\n"),
        "pkg/msg/T uses other/msg/Deep, which is not defined; give the .msg file of other/msg/Deep"
    );
    assert!(tree_error("Header header\n").starts_with("pkg/msg/T uses pkg/msg/Header, which is not defined"));
}

#[test]
fn types_that_never_end_are_refused() {
    let line = "=".repeat(80);
    assert!(tree_error("T[] inner\n").starts_with("pkg/msg/T contains itself, by way of pkg/msg/T"));
    let circle = format!("A a\n{line}\nMSG: pkg/A\nB b\n{line}\nMSG: pkg/B\nA a\n");
    assert!(tree_error(&circle).starts_with("pkg/msg/A contains itself, by way of pkg/msg/B"));
    let mut deep = "L0 a\n".to_owned();
    let mut wide = "L0 a\nL0 b\n".to_owned();
    for level in 0..40 {
        let next = level + 1;
        deep.push_str(&format!("{line}\nMSG: pkg/L{level}\nL{next} a\n"));
        wide.push_str(&format!("{line}\nMSG: pkg/L{level}\n"));
        wide.push_str(&if level < 25 { format!("L{next} a\nL{next} b\n") } else { "int8 a\n".to_owned() });
    }
    assert_eq!(tree_error(&deep), "pkg/msg/T nests more than 32 messages deep; a message of a robot does not");
    assert!(tree_error(&wide).contains("has more than 4096 fields"), "{}", tree_error(&wide));
}

#[test]
fn separators_without_a_name_are_refused() {
    let text = format!("int32 a\n{}\nint32 b\n", "=".repeat(80));
    assert_eq!(
        tree_error(&text),
        "schema of pkg/msg/T, line 3: expected 'MSG: package/Name' after the separator, got 'int32 b'"
    );
}

#[test]
fn a_service_text_makes_its_event_request_and_response() {
    let text = "int64 a\n---\nint64 sum\n";
    let event = TypeTree::from_schema("pkg/srv/Add_Event", text).expect("it resolves");
    let fields: Vec<String> = event.root().fields.iter().map(|field| format!("{} {}", field.ty, field.name)).collect();
    assert_eq!(
        fields,
        [
            "service_msgs/msg/ServiceEventInfo info",
            "pkg/srv/Add_Request[<=1] request",
            "pkg/srv/Add_Response[<=1] response"
        ]
    );
    let response = TypeTree::from_schema("pkg/srv/Add_Response", text).expect("it resolves");
    assert!(response.root().field("sum").is_some() && response.root().field("a").is_none());
    assert!(TypeTree::from_schema("pkg/srv/Add", text).is_err());
    assert!(tree_error(text).contains("parts divided by '---'"));
}

/// A `.msg` file as rosidl_adapter converts it to IDL.
const PATCH_IDL: &str = r#"================================================================================
IDL: glove_msgs/msg/Patch
// generated from rosidl_adapter/resource/msg.idl.em
#include "std_msgs/msg/Header.idl"

module glove_msgs {
  module msg {
    typedef double double__9[9];
    typedef glove_msgs::msg::Cell glove_msgs__msg__Cell;
    const unsigned long SIZE = 4;
    typedef glove_msgs__msg__Cell glove_msgs__msg__Cell__2[2];
    module Patch_Constants {
      @verbatim (language="comment", text="of (two) \"lines\"" "\n" "more; }")
      const string NAME = "a; }";
      const float HALF = -0.5;
    };
    enum Side { LEFT, RIGHT };
    @verbatim (language="comment", text="A patch")
    struct Patch {
      @unit (value="N") std_msgs::msg::Header header; /* and
      more */
      double__9 covariance;
      sequence<glove_msgs__msg__Cell, 3> cells;
      glove_msgs__msg__Cell__2 pair, pairs[3];
      unsigned long side;
      sequence<uint8> raw;
      @default (value=TRUE)
      boolean on; octet flags;
      string<12> name; wstring label; sequence<string<5>, SIZE> names;
      unsigned long long a, b[2][3];
      long long c; short d; unsigned short e; long f; float g; int8 h;
    };
  };
};
================================================================================
IDL: glove_msgs/msg/Cell
module glove_msgs { module msg { struct Cell { int16 _value; builtin_interfaces::msg::Time stamp; }; }; };
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
"#;

#[test]
fn idl_says_what_msg_says() {
    let tree = TypeTree::from_encoded("glove_msgs/msg/Patch", "ros2idl", PATCH_IDL).unwrap();
    let bar = "=".repeat(80);
    let msg = format!(
        "std_msgs/Header header\nfloat64[9] covariance\nCell[<=3] cells\nCell[2] pair\nCell[6] pairs\nuint32 side\nuint8[] raw\nbool on\nbyte flags\nstring<=12 \
         name\nwstring label\nstring<=5[<=4] names\nuint64 a\nuint64[6] b\nint64 c\nint16 d\nuint16 e\nint32 \
         f\nfloat32 g\nint8 h\n{bar}\nMSG: glove_msgs/Cell\nint16 value\nbuiltin_interfaces/Time stamp\n{bar}\nMSG: \
         std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    );
    let same = TypeTree::from_schema("glove_msgs/msg/Patch", &msg).unwrap();
    assert_eq!(tree, same);
    let empty = "module p { module msg { struct E { uint8 structure_needs_at_least_one_member; }; }; };";
    assert!(TypeTree::from_encoded("p/msg/E", "ros2idl", empty).unwrap().root().fields.is_empty());
}

#[test]
fn idl_that_is_no_message_is_refused_with_its_line() {
    let refused = |text: &str| TypeTree::from_encoded("p/msg/T", "ros2idl", text).unwrap_err().to_string();
    let in_module = |text: &str| refused(&format!("module p {{ module msg {{\n{text}\n}}; }};"));
    assert!(in_module("typedef Later L; struct T { L x; };").contains("line 2: 'Later' is not a type name"));
    assert!(in_module("struct T { sequence<sequence<long>> x; };").contains("line 2: "));
    assert!(in_module("struct T { T x; };").contains("contains itself"));
    assert!(in_module("struct T { q::msg::U x; };").contains("q/msg/U, which is not defined"));
    assert!(in_module("struct T { long x[0]; };").contains("'0' is no bound"));
    assert!(in_module("struct T { long x[4294967295][2]; };").contains("more than 4294967295"));
    assert!(in_module("struct T { long x; long x; };").contains("defined twice"));
    assert!(in_module("union T switch(long) { case 0: long x; };").contains("'union' is not read"));
    assert!(in_module("struct T { @key(").contains("ends within"));
    for used in ["E x;", "p::msg::E x;", "sequence<E> x;", "E x[2];"] {
        let line = in_module(&format!("enum E {{ A, B }};\nstruct T {{ {used} }};"));
        assert!(line.contains("p/msg/T, line 3: '") && line.contains("is an enum"), "{line}");
        let line = in_module(&format!("struct T {{ {used} }};\nenum E {{ A, B }};"));
        assert!(line.contains("p/msg/T, line 2: '") && line.contains("is an enum"), "{line}");
    }
    assert!(in_module("struct T { wchar x; };").contains("'wchar' is not read"));
    assert!(refused("").contains("no struct of that name"));
    assert!(refused(&"module m {".repeat(100)).contains("nested too deep"));
    assert!(refused(&" ".repeat(5 << 20)).contains("expected at most"));
    let many = format!("module p {{ module msg {{ struct T {{ {} }}; }}; }};", "long x;".repeat(5000));
    assert!(refused(&many).contains("more than 4096 fields"));
    assert!(TypeTree::from_encoded("p/msg/T", "", "").unwrap_err().to_string().contains("AMENT_PREFIX_PATH"));
}
