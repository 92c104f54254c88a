// SPDX-License-Identifier: Apache-2.0
// The page's own part in the browser: naming things, speaking and listening. It sends nothing anywhere.
(() => {
  const box = () => document.querySelector("#words textarea, #words input");
  const language = () => document.documentElement.lang || "en";

  function write(words) {
    const field = box();
    field.value = words;
    field.dispatchEvent(new Event("input", { bubbles: true }));
    field.focus();
  }

  // A thing in the picture was chosen: its name comes behind what is written already.
  document.addEventListener("click", (event) => {
    const thing = event.target.closest("[data-thing]");
    if (thing) write([box().value.trimEnd(), `the ${thing.dataset.thing}`].filter(Boolean).join(" "));
  });

  let aloud = false;
  window.owlxt5Say = (line) => {
    if (!aloud || !line) return;
    const speech = new SpeechSynthesisUtterance(line);
    speech.lang = "en";
    speechSynthesis.speak(speech);
  };

  window.owlxt5Speech = (root) => {
    const listen = root.querySelector("#listen"), speak = root.querySelector("#speak");
    const Recognition = window.SpeechRecognition || window.webkitSpeechRecognition;
    speak.hidden = !("speechSynthesis" in window);
    speak.addEventListener("click", () => {
      aloud = !aloud;
      speak.setAttribute("aria-pressed", aloud);
      if (!aloud) speechSynthesis.cancel();
    });
    listen.hidden = !Recognition;
    if (!Recognition) return;
    let ear = null;
    listen.addEventListener("click", () => {
      if (ear) return ear.stop();
      ear = new Recognition();
      ear.lang = language() === "de" ? "de-DE" : "en-US";
      ear.onresult = (event) => write(event.results[0][0].transcript);
      ear.onend = () => { ear = null; listen.setAttribute("aria-pressed", false); };
      listen.setAttribute("aria-pressed", true);
      ear.start();
    });
  };
})();
