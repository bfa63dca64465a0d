//! Which files use which: the paths in their code, followed through re-exports to where a name is defined.

use std::collections::{BTreeMap, BTreeSet};

/// A module by its path from the root of the crate, such as `["eval", "curve"]`.
pub type Module = Vec<String>;

/// The code of each module, without comments, texts and tests.
pub type Sources = BTreeMap<Module, String>;

/// Modules with the same parent that use one another, each with the uses that close the circle.
///
/// A module may use its parents, whose types its siblings share; what it may not do is to use a sibling that uses it,
/// by itself or by a module inside of it.
pub fn between_siblings(sources: &Sources) -> Vec<String> {
    let exports: BTreeMap<&Module, BTreeMap<String, Vec<String>>> =
        sources.iter().map(|(module, code)| (module, exports_of(code))).collect();
    let mut uses: BTreeMap<Module, BTreeMap<String, BTreeMap<String, String>>> = BTreeMap::new();
    for (module, code) in sources {
        for path in paths_of(code) {
            let Some(path) = absolute(sources, module, &path) else { continue };
            let Some(used) = defined_in(sources, &exports, &path, 0) else { continue };
            let n_common = module.iter().zip(&used).take_while(|(a, b)| a == b).count();
            if n_common < module.len() && n_common < used.len() {
                let siblings = uses.entry(module[..n_common].to_vec()).or_default();
                let by = siblings.entry(module[n_common].clone()).or_default();
                by.entry(used[n_common].clone())
                    .or_insert_with(|| format!("{} uses {}", module.join("::"), used.join("::")));
            }
        }
    }
    let mut circles = Vec::new();
    for siblings in uses.values() {
        for (module, used) in siblings {
            for (other, how) in used {
                if let Some(back) = way(siblings, other, module) {
                    circles.push(format!("{how}, and back: {}", back.join(", ")));
                }
            }
        }
    }
    circles
}

/// How one sibling comes to use another, over others.
fn way(siblings: &BTreeMap<String, BTreeMap<String, String>>, from: &str, to: &str) -> Option<Vec<String>> {
    let mut known = BTreeSet::from([from.to_owned()]);
    let mut open = vec![(from.to_owned(), Vec::new())];
    while let Some((at, steps)) = open.pop() {
        for (next, how) in siblings.get(&at).into_iter().flatten() {
            let steps: Vec<String> = steps.iter().cloned().chain([how.clone()]).collect();
            if next == to {
                return Some(steps);
            }
            if known.insert(next.clone()) {
                open.push((next.clone(), steps));
            }
        }
    }
    None
}

/// Names that a module re-exports, and the paths behind them.
fn exports_of(code: &str) -> BTreeMap<String, Vec<String>> {
    let mut exports = BTreeMap::new();
    for (is_public, tree) in use_trees(code) {
        if is_public {
            for path in expanded(tree, &[]) {
                exports.extend(path.last().cloned().map(|name| (name, path)));
            }
        }
    }
    exports
}

/// Every path that the code names, but for re-exports of what is inside of the module.
pub fn paths_of(code: &str) -> Vec<Vec<String>> {
    let trees = use_trees(code);
    let mut paths: Vec<Vec<String>> =
        trees.iter().filter(|(is_public, _)| !is_public).flat_map(|(_, tree)| expanded(tree, &[])).collect();
    let mut rest = code.to_owned();
    for (_, tree) in trees {
        rest = rest.replace(tree, " ");
    }
    let is_path = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == ':';
    let words = rest.split(|c: char| !is_path(c)).filter(|word| word.contains("::"));
    paths.extend(words.map(|word| word.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect()));
    paths
}

/// What stands between each `use` and its semicolon, and whether it is public.
fn use_trees(code: &str) -> Vec<(bool, &str)> {
    let mut trees = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find("use ") {
        let before = rest[..at].trim_end();
        let begins = rest[..at].chars().next_back().is_none_or(char::is_whitespace);
        rest = &rest[at + 4..];
        let Some(end) = rest.find(';').filter(|_| begins) else { continue };
        let is_public = before.ends_with("pub")
            || before.rsplit("pub(").next().is_some_and(|vis| {
                before.contains("pub(") && vis.ends_with(')') && !vis[..vis.len() - 1].contains([')', '\n'])
            });
        trees.push((is_public, &rest[..end]));
        rest = &rest[end..];
    }
    trees
}

/// The paths of a tree such as `super::{a::B, c}`.
fn expanded(tree: &str, before: &[String]) -> Vec<Vec<String>> {
    let (mut items, mut depth, mut item) = (Vec::new(), 0, String::new());
    for c in tree.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                items.push(std::mem::take(&mut item));
                continue;
            }
            _ => {}
        }
        item.push(c);
    }
    items.push(item);
    let parts = |path: &str| -> Vec<String> {
        path.split("::").map(|part| part.trim().to_owned()).filter(|part| !part.is_empty()).collect()
    };
    let of_item = |item: String| match item.split_once('{') {
        Some((head, inner)) => {
            let head: Vec<String> = before.iter().cloned().chain(parts(head)).collect();
            expanded(inner.trim_end().trim_end_matches('}'), &head)
        }
        None => {
            let path = item.split(" as ").next().unwrap_or_default();
            let path: Vec<String> = before.iter().cloned().chain(parts(path)).filter(|part| part != "*").collect();
            vec![path]
        }
    };
    items.into_iter().flat_map(of_item).filter(|path| !path.is_empty()).collect()
}

/// A path from the root of the crate; `None` where it leads out of the crate.
fn absolute(sources: &Sources, module: &[String], path: &[String]) -> Option<Vec<String>> {
    let of_module = |n_up: usize, rest: &[String]| {
        let kept = module.len().checked_sub(n_up)?;
        Some(module[..kept].iter().chain(rest).cloned().collect::<Vec<String>>())
    };
    match path.first()?.as_str() {
        "crate" => Some(path[1..].to_vec()),
        "self" => of_module(0, &path[1..]),
        "super" => {
            let n_up = path.iter().take_while(|part| *part == "super").count();
            of_module(n_up, &path[n_up..])
        }
        first => {
            let inner: Module = module.iter().cloned().chain([first.to_owned()]).collect();
            sources.contains_key(&inner).then(|| of_module(0, path)).flatten()
        }
    }
}

/// The module in which the end of a path is defined.
fn defined_in(
    sources: &Sources,
    exports: &BTreeMap<&Module, BTreeMap<String, Vec<String>>>,
    path: &[String],
    n_followed: usize,
) -> Option<Module> {
    let mut at = Module::new();
    for (idx, part) in path.iter().enumerate() {
        let inner: Module = at.iter().cloned().chain([part.clone()]).collect();
        if sources.contains_key(&inner) {
            at = inner;
            continue;
        }
        if let Some(export) = exports.get(&at).and_then(|exports| exports.get(part)).filter(|_| n_followed < 8) {
            let mut target = absolute(sources, &at, export)?;
            target.extend_from_slice(&path[idx + 1..]);
            return defined_in(sources, exports, &target, n_followed + 1);
        }
        return Some(at);
    }
    Some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sources(of: &[(&str, &str)]) -> Sources {
        of.iter().map(|(path, code)| (path.split("::").map(str::to_owned).collect(), (*code).to_owned())).collect()
    }

    #[test]
    fn a_circle_is_found_over_files_folders_and_re_exports() {
        let plain = [("a", ""), ("a::b", "use super::c::{self, X};"), ("a::c", "fn f() { super::b::g(); }")];
        assert_eq!(between_siblings(&sources(&plain)).len(), 2, "told from both sides");
        let exported = [
            ("a", "mod b;\npub use b::G;"),
            ("a::b", "use super::c::X;"),
            ("a::c", ""),
            ("a::c::d", "use crate::a::{Other, G};"),
        ];
        assert_eq!(between_siblings(&sources(&exported)).len(), 2, "{:?}", between_siblings(&sources(&exported)));
        let over = [("a", "use crate::b::X;"), ("b", "use crate::c::Y;"), ("c", "use crate::a::Z;")];
        assert_eq!(between_siblings(&sources(&over)).len(), 3);
    }

    #[test]
    fn a_parent_may_be_used_and_one_direction_is_no_circle() {
        let parent = [("a", "mod b;\nuse b::X;\nstruct Shared;"), ("a::b", "use super::Shared;")];
        assert!(between_siblings(&sources(&parent)).is_empty());
        let one_way = [("a", "use crate::b::X;"), ("b", "")];
        assert!(between_siblings(&sources(&one_way)).is_empty());
    }
}
