// SPDX-License-Identifier: Apache-2.0
// The page's own part in the browser: naming things, speaking and listening. It sends nothing anywhere.
(() => {
  const input = (id) => document.querySelector(`#${id} textarea, #${id} input`);
  const box = () => input("words");
  const language = () => document.documentElement.lang || "en";

  function fill(field, words) {
    field.value = words;
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }

  function write(words) {
    fill(box(), words);
    box().focus();
  }

  // Somebody points at the picture. The name of a chosen thing comes behind what is written already.
  document.addEventListener("click", (event) => {
    const picture = event.target.closest("#seen")?.querySelector("img");
    if (!picture) return;
    const { left, top, width, height } = picture.getBoundingClientRect();
    const thing = event.target.closest("[data-thing]");
    const around = thing?.getBoundingClientRect();
    const x = around ? around.left + around.width / 2 : event.clientX;
    const y = around ? around.top + around.height / 2 : event.clientY;
    fill(input("place"), `${(x - left) / width} ${(y - top) / height}`);
    if (thing) write([box().value.trimEnd(), `the ${thing.dataset.thing}`].filter(Boolean).join(" "));
    else box().focus();
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
